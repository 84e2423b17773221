/* One injection: prints time, rate of injection and needle lift every 10 us, then the figures.
 *
 *     cc -O2 example.c cr.c FOLDER/cr_kernel_PLATFORM.o -lm -o example
 */
#include <stdio.h>
#include <stdlib.h>
#include "cr_commonrail.h"

int main(void) {
    double parameters[CR_PARAMETERS], channels[CR_CHANNELS], before = 0.0;
    const double step = 1e-6;
    const cr_boundary boundary = {160e6, 5e6, 0.5e6, 0.0};
    const cr_energising energising = {0.0, 700e-6};
    cr_figures figures;
    cr_defaults(parameters);
    size_t size = cr_state_size(parameters, step);
    void *state = size ? malloc(size) : NULL;
    if (!state) return 1;
    int status = cr_begin(state, size, parameters, &boundary, step, 0.0);
    if (!status) status = cr_plan(state, &energising, 1);
    printf("time [us], rate [mg/ms], needle lift [um]\n");
    while (!status && cr_steps(state) < 3000) {
        status = cr_march(state, 10, &boundary);
        cr_observe(state, channels);
        printf("%.0f, %.4f, %.2f\n", cr_time(state) * 1e6, (channels[0] - before) / (10.0 * step) * 1e3, channels[3] * 1e6);
        before = channels[0];
    }
    if (!status) status = cr_status(state);
    cr_read_figures(state, &figures);
    printf("injected %.3f mg, opening %.1f us, closing %.1f us\n", figures.injected * 1e6, figures.opening * 1e6,
           figures.closing * 1e6);
    printf("%s\n", cr_sentence(status));
    free(state);
    return status ? 1 : 0;
}
