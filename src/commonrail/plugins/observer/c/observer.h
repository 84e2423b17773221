/* Observer of one injector: quantity, opening and closing of each shot, and the drift of the injector, from samples of a
 * measured pressure and the command. It is the filter of commonrail's observe, with the disturbance's figures fixed.
 *
 * All numbers are in SI units. The observer is one block of memory that the caller owns (cr_observer_size); its functions
 * allocate nothing. Take a step for each sample, every CR_SAMPLING seconds. A shot is complete CR_PAUSE after its last
 * energising; it is evaluated in slices over the following steps, so that no single step takes long.
 */
#ifndef CR_OBSERVER_HEADER
#define CR_OBSERVER_HEADER
#include "cr_commonrail.h"
#ifdef __cplusplus
extern "C" {
#endif

/*SIZES*/
/* Figures of one injection, and their standard deviations: volume [m3], and instants from the shot's first energising on
 * [s]; NaN where there is none, and the deviations of an injection that does not open. */
typedef struct cr_injection {
    double quantity, opening, closing;
    double quantity_deviation, opening_deviation, closing_deviation;
} cr_injection;

typedef struct cr_observed {
    double shots;       /* evaluated so far; the rest is of the last one */
    double valid;       /* 1; 0 where it could not be simulated, and before the first: it has no figures, and taught nothing */
    double start;       /* of its first energising, after the first sample [s] */
    double rail_pressure; /* shown before it [Pa] */
    double injections;
    double consistency; /* squared innovation over its expectation, 1 on average; beyond CR_TRUSTED nothing was
                         * learnt; NaN without figures */
    double missed;      /* shots so far without figures: too long, or begun before the one before was evaluated */
    double failed;      /* shots so far that could not be simulated */
    double alarms;      /* so far */
    double alarm;       /* state that drifted, as alarmed at this shot, counted from 1; 0: none */
    double alarm_ago, alarm_size, alarm_deviation; /* shots since, and step with its standard deviation */
    double longest;     /* inner work of the longest step so far, in steps of a block */
    cr_injection injection[CR_MOST_INJECTIONS];
    double drift[CR_STATES], drift_deviation[CR_STATES];
} cr_observed;

CR_API const char *cr_state_name(int index);
CR_API const char *cr_state_unit(int index);
CR_API size_t cr_observer_size(void); /* bytes */
/* Begin before the first shot; `memory` must be aligned for doubles, and is fastest aligned to 64
 * bytes; copy its bytes to keep a state. `work`: inner work of a step at most, in time steps of
 * a block of injectors, 0 for CR_WORK_OF_STEP. Takes as long as some shots. Returns CR_OK, CR_BAD_MEMORY,
 * CR_OUTSIDE_DOMAIN where `work` is negative or not finite, or a status of cr_check. */
CR_API int cr_observer_begin(void *memory, size_t size, double work);
/* One sample: pressure now, and the share of the sampling interval that ends now in which the coil was energised, 0 to 1.
 * Returns 0, or CR_BAD_BOUNDARY where a number is not finite or 10 GPa: the last sample counts again. */
CR_API int cr_observer_step(void *memory, double pressure, double command);
CR_API void cr_observer_read(const void *memory, cr_observed *observed);

#ifdef __cplusplus
}
#endif
#endif
