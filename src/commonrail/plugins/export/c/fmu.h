/* Variables of the injector's FMU. */
#ifndef CR_FMU
#define CR_FMU
#include "cr_commonrail.h"

/*START*/
/* Value references: parameters from 0, then these. */
enum {
    VR_STEP = 1000,   /* inner time step [s] */
    VR_PLAN = 1001,   /* start and duration of each planned energising [s] */
    VR_INPUT = 2000,  /* fields of cr_boundary */
    VR_COMMAND = 2100,
    VR_TIME = 2200, /* the independent variable of FMI 3.0 */
    VR_CHANNEL = 3000,
    VR_RATE = 4000,   /* mean injection rate over the inner steps of the last communication step [kg/s] */
    VR_RETURN_RATE,   /* the same of the return flow [kg/s] */
    VR_OPENING,       /* instants of the needle [s], 0 where there is none yet */
    VR_CLOSING,
    VR_FIRST_CLOSING,
    VR_OPEN,          /* the needle is open */
    VR_STATUS
};
#define PLANNED 4
#define MOST_STEPS 1e7 /* inner steps of a communication step: seconds of computing, after which the importer asks again */
#define TOO_LONG "A communication step takes more than 10 million inner time steps; take several shorter ones."

typedef struct { /* plain data: what a state is, but for the numbers of the simulation */
    double parameters[CR_PARAMETERS], step, plan[2 * PLANNED];
    cr_boundary input;
    double begun, time, rate, return_rate, injected, returned;
    int32_t command, commanded, phase, dirty;
} Kept;

typedef struct { /* read once a step */
    double channels[CR_CHANNELS];
    cr_figures figures;
} Seen;
#include "cr_instance.h"
#endif
