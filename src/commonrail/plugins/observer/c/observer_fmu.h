/* Variables of the observer's FMU. */
#ifndef CR_FMU
#define CR_FMU
#include "cr_commonrail.h"
#include "cr_observer.h"

/*START*/
enum { /* value references */
    VR_PRESSURE, /* inputs */
    VR_SHARE,
    VR_WORK,      /* parameter */
    VR_OUT = 100, /* fields of cr_observed */
    VR_TIME = 10000, /* the independent variable of FMI 3.0 */
    VR_OPEN,      /* references of the injector's FMU that are none here */
    VR_COMMAND,
    VR_STATUS
};
#define TOO_LONG "A communication step holds more than 10 million samples; take several shorter ones."

typedef struct { /* plain data: what a state is, but for the observer's memory */
    double pressure, share, work;
    double begun, time, energised; /* energised: time in the present sampling interval [s] */
    int64_t samples;
    int32_t command, phase, dirty;
} Kept;

typedef struct {
    cr_observed out;
} Seen;
#include "cr_instance.h"
#endif
