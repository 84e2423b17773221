/* Time of each step of an exported library: one injector, or eight in a block. For benchmarks/library_speed.py, which gives
 * the model's name as CR_NAME through a generated header.
 *
 * Arguments: time step [s], lanes that are computed at once (0: one injector alone), injections. Every piece of an
 * injection takes its shortest time of all injections, so that other programs on the machine count little. Prints the mass
 * injected [kg]; time of an injection marched in pieces of 32 steps [ns], and in ticks of the time stamp counter; median
 * and longest of the steps of an injection, each called alone [ns]; the longest step of all, interruptions included; steps.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "cr_block.h"
#if defined(__x86_64__)
#include <x86intrin.h>
#define TICKS() __rdtsc()
#else
#define TICKS() 0ull
#endif

#define PIECE 32

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}
static int order(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}
static void keep_least(double *kept, double found) {
    if (!(*kept > 0.0) || found < *kept) *kept = found;
}

int main(int count, char **words) {
    if (count < 4) return 2;
    double step = atof(words[1]), parameters[8 * CR_PARAMETERS], mass = 0.0;
    int vectors = atoi(words[2]), rounds = atoi(words[3]), n = vectors ? 8 : 1;
    int64_t steps = (int64_t)(1.56e-3 / step + 0.5);
    cr_boundary boundaries[8];
    const cr_energising energising = {0.0, 700e-6};
    for (int i = 0; i < n; i++) {
        cr_defaults(parameters + i * CR_PARAMETERS);
        boundaries[i] = (cr_boundary){160e6, 5e6, 0.5e6, 0.0};
    }
    size_t size = vectors ? cr_block_size(parameters, n, step) : cr_state_size(parameters, step);
    double *piece = calloc(2 * steps, sizeof *piece), *single = calloc(steps, sizeof *single), longest = 0.0;
    void *state = aligned_alloc(64, (size + 63) / 64 * 64);
    for (int round = 0; round < 2 * rounds; round++) { /* the second half calls every step alone */
        int status = vectors ? cr_block_begin(state, size, parameters, boundaries, n, vectors, step, 0.0)
                             : cr_begin(state, size, parameters, boundaries, step, 0.0);
        for (int i = 0; i < n && !status; i++)
            status = vectors ? cr_block_plan(state, i, &energising, 1) : cr_plan(state, &energising, 1);
        if (status) return puts(cr_sentence(status)), 1;
        int64_t at_once = round < rounds ? PIECE : 1;
        for (int64_t k = 0; k < steps; k += at_once) {
            int64_t marched = steps - k < at_once ? steps - k : at_once;
            double begin = now();
            unsigned long long ticks = TICKS();
            vectors ? cr_block_march(state, marched, boundaries) : cr_march(state, marched, boundaries);
            ticks = TICKS() - ticks;
            double took = now() - begin;
            if (at_once == 1) {
                keep_least(single + k, took);
                if (took > longest) longest = took;
            } else {
                keep_least(piece + 2 * (k / PIECE), took);
                keep_least(piece + 2 * (k / PIECE) + 1, (double)ticks);
            }
        }
    }
    double whole[2] = {0.0, 0.0};
    for (int64_t k = 0; k < steps; k += PIECE)
        for (int i = 0; i < 2; i++) whole[i] += piece[2 * (k / PIECE) + i];
    cr_figures figures;
    vectors ? cr_block_read_figures(state, 0, &figures) : cr_read_figures(state, &figures);
    mass = figures.injected;
    qsort(single, steps, sizeof *single, order);
    printf("%.17g %.0f %.0f %.0f %.0f %.0f %lld\n", mass, whole[0], whole[1], single[steps / 2], single[steps - 1], longest,
           (long long)steps);
    return 0;
}
