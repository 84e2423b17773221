/* One instance of the FMU, common to both versions of the standard. */
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

typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

typedef struct { /* plain data: what a state is, but for the numbers of the simulation */
    double parameters[CR_PARAMETERS], step, plan[2 * PLANNED];
    cr_boundary input;
    double begun, time, rate, return_rate, injected, returned;
    int32_t command, commanded, phase, dirty;
} Kept;

typedef struct {
    Kept kept;
    void *state;
    size_t size;
    double channels[CR_CHANNELS];
    cr_figures figures;
    int observed;
    const char *sentence; /* of the last failure */
    char *name;
    void *environment; /* of the importer: its logger and what the logger wants */
    void (*logger)(void);
} Instance;

Instance *fmu_new(const char *name);
void fmu_free(Instance *m);
void fmu_preset(Instance *m);
double *fmu_writable(Instance *m, unsigned reference); /* NULL: no such number, or not now */
int fmu_read(Instance *m, unsigned reference, double *value); /* 0: no such number */
int fmu_begin(Instance *m); /* a status */
int fmu_too_long(const Instance *m, double length); /* 1: more than MOST_STEPS inner steps */
int fmu_step(Instance *m, double now, double length); /* a status */

/* States kept for the importer; the functions return 0 where they fail. */
int fmu_get_state(const Instance *m, void **kept); /* writes over one of the same size */
int fmu_set_state(Instance *m, const void *kept);
void fmu_free_state(void **kept);
size_t fmu_state_size(const void *kept);
int fmu_write_state(const void *kept, void *bytes, size_t size);
int fmu_read_state(void **kept, const void *bytes, size_t size);
#endif
