/* One call simulates one injection. The entries of the physics follow Numba's calling convention. */
#include <stdint.h>

#define EXPORT(name) __attribute__((export_name(#name)))

int32_t cr_kernel_begin(void *result, void **exception, double *work, double *waves, int64_t ring, double *theta,
                        double rail, double cylinder, double low, double dt, double *figures);
int32_t cr_kernel_march(void *result, void **exception, double *work, double *waves, int64_t ring, int64_t first,
                        int64_t count, double *inputs, double dt);
int32_t cr_kernel_observe(void *result, void **exception, double *work, double *channels);
int32_t cr_kernel_figures(void *result, void **exception, double *work, double cylinder, double *figures);

static double theta[CR_COLUMNS], work[CR_WORK], waves[3 * CR_SLOTS + CR_COLUMNS], figures[CR_FIGURES];
static double inputs[6 * CR_STEPS], injected[CR_STEPS + 1], channels[(CR_ROWS + 1) * CR_CHANNELS];

EXPORT(theta) double *get_theta(void) { return theta; }
EXPORT(inputs) double *get_inputs(void) { return inputs; }
EXPORT(injected) double *get_injected(void) { return injected; }
EXPORT(channels) double *get_channels(void) { return channels; }
EXPORT(figures) double *get_figures(void) { return figures; }

/* Simulates `steps` steps of `inputs`, from rest at the given pressures; keeps the mass injected after every `stride` steps,
   and the channels of the start and after every `every` steps (0: never; then `stride` is 1). From step `quiet` on it ends once needle and valve
   have rested for `patience` steps (0: it does not end). Returns the number of steps, or -1 if the memory does not
   suffice. */
EXPORT(simulate)
int32_t simulate(int32_t steps, int32_t every, int32_t stride, int32_t ring, int32_t quiet, int32_t patience, double dt, double rail,
                 double cylinder, double low) {
    void *result[2];
    int32_t rows = 0, rested = 0, k = 0;
    if (steps < 1 || steps > CR_STEPS || ring > CR_SLOTS || (every > 0 && steps / every > CR_ROWS)) return -1;
    cr_kernel_begin(result, result + 1, work, waves, ring, theta, rail, cylinder, low, dt, figures);
    injected[0] = work[CR_INJECTED];
    if (every > 0) cr_kernel_observe(result, result + 1, work, channels);
    while (k < steps && !(patience > 0 && k > quiet && rested > patience)) {
        int32_t count = steps - k < stride ? steps - k : stride;
        cr_kernel_march(result, result + 1, work, waves, ring, k, count, inputs + 6 * k, dt);
        k += count;
        injected[k] = work[CR_INJECTED];
        if (every > 0 && k % every == 0)
            cr_kernel_observe(result, result + 1, work, channels + ++rows * CR_CHANNELS);
        rested = work[CR_TIP] <= 0.0 && work[CR_VALVE] <= 0.0 ? rested + count : 0;
    }
    cr_kernel_figures(result, result + 1, work, inputs[6 * (k - 1) + 1], figures);
    return k;
}
