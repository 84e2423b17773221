/* The injectors of a four-cylinder engine in one call, each with an operating point and an energising of its own:
 * prints what each has injected every 100 us, then the figures.
 *
 *     c++ -O2 example.cpp FOLDER/libcr.a -lm -o example_cpp
 */
#include <cstdio>
#include <vector>
#include "cr_block.h"

int main() {
    const int cylinders = 4;
    const double step = 1e-6;
    std::vector<double> parameters(cylinders * CR_PARAMETERS);
    std::vector<cr_boundary> boundaries;
    for (int i = 0; i < cylinders; i++) {
        cr_defaults(parameters.data() + i * CR_PARAMETERS);
        boundaries.push_back({160e6 - 10e6 * i, 5e6, 0.5e6, 0.0});
    }
    const std::size_t size = cr_block_size(parameters.data(), cylinders, step);
    std::vector<double> memory(size / sizeof(double));
    void *block = memory.data();
    int status = cr_block_begin(block, size, parameters.data(), boundaries.data(), cylinders, 0, step, 0.0);
    for (int i = 0; i < cylinders && !status; i++) {
        const cr_energising energising = {100e-6 * i, 700e-6};
        status = cr_block_plan(block, i, &energising, 1);
    }
    std::printf("%d injectors, %d computed at once\ntime [us], injected by each [mg]\n", cylinders, cr_block_vectors(block));
    while (!status && cr_block_time(block) < 2.99995e-3) {
        status = cr_block_march(block, 100, boundaries.data());
        std::printf("%.0f", cr_block_time(block) * 1e6);
        for (int i = 0; i < cylinders; i++) {
            double channels[CR_CHANNELS];
            cr_block_observe(block, i, channels);
            std::printf(", %.3f", channels[0] * 1e6);
        }
        std::printf("\n");
    }
    for (int i = 0; i < cylinders; i++) {
        cr_figures figures;
        cr_block_read_figures(block, i, &figures);
        if (!status) status = cr_block_status(block, i);
        std::printf("injector %d: injected %.3f mg, opening %.1f us, closing %.1f us\n", i + 1, figures.injected * 1e6,
                    figures.opening * 1e6, figures.closing * 1e6);
    }
    std::printf("%s\n", cr_sentence(status));
    return status ? 1 : 0;
}
