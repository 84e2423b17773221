/* Several injectors of one model side by side, e.g. those of an engine, each with parameters and an operating point of its
 * own. On processors with AVX2 or AVX-512 they are computed together, in the lanes of vector registers; elsewhere one
 * after another. Time and time step are common.
 *
 * A block is memory of the caller's, as a simulation is: copy its bytes to keep a state. Bytes that were kept on another
 * machine may be used where cr_vectors() is at least cr_block_vectors(block). Aligned to 64 bytes it is fastest.
 */
#ifndef CR_BLOCK_HEADER
#define CR_BLOCK_HEADER
#include "cr_commonrail.h"
#ifdef __cplusplus
extern "C" {
#endif

#define CR_LANES /*LANES*/ /* injectors of a block, at most */

/* Numbers that this processor computes at once: 8, 4, or 1 where injectors are computed one after another. It asks the
 * processor, which takes microseconds on a virtual machine. */
CR_API int cr_vectors(void);
/* Bytes of a block of `count` injectors; 0 where parameters or time step are outside their domains.
 * `parameters`: CR_PARAMETERS numbers of each injector, one injector after another. */
CR_API size_t cr_block_size(const double *parameters, int count, double time_step);
/* Begin at rest. `block` must be aligned for doubles; `at_rest` has an element for each injector; `vectors` is the
 * largest number of lanes computed at once, 0 for as many as the processor has. Returns a status: 0, or the first
 * injector's that has another. */
CR_API int cr_block_begin(void *block, size_t size, const double *parameters, const cr_boundary *at_rest, int count,
                          int vectors, double time_step, double start);
CR_API int cr_block_vectors(const void *block); /* lanes that are computed at once: 8, 4 or 1 */
CR_API int cr_block_count(const void *block);   /* injectors */
/* As cr_plan and cr_switch, of one injector, counted from 0. */
CR_API int cr_block_plan(void *block, int injector, const cr_energising *energisings, int count);
CR_API int cr_block_switch(void *block, int injector, double time, int on);
/* March `steps` time steps; `boundaries` has an element for each injector. Returns CR_OK or the failure of the first
 * injector that has one: that one stands still, the others continue. */
CR_API int cr_block_march(void *block, int64_t steps, const cr_boundary *boundaries);
/* March with the inputs of each step given: those of all injectors in the first step, then in the next. */
CR_API int cr_block_march_inputs(void *block, int64_t steps, const cr_inputs *inputs);
CR_API double cr_block_time(const void *block); /* [s] */
CR_API int cr_block_status(const void *block, int injector);
CR_API void cr_block_observe(const void *block, int injector, double channels[CR_CHANNELS]);
CR_API void cr_block_read_figures(const void *block, int injector, cr_figures *figures);

#ifdef __cplusplus
}
#endif
#endif
