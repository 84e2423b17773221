/* What the sources of one model share: sizes, head of a simulation, compiled entries, mode of the processor. */
#ifndef CR_CORE
#define CR_CORE
#include <stdint.h>
#include "cr_commonrail.h"
#if defined(__x86_64__) || defined(_M_X64)
#include <xmmintrin.h>
#endif

/*DEFINES*/
#define CHUNK 32 /* steps whose inputs are on the stack at once, and after which the health of a simulation is checked */

/* Convention of the compiled entries: place of a result, place of an exception, which is never written, arguments. */
extern int32_t cr_kernel_begin(void *, void *, double *work, double *waves, int64_t ring, const double *theta,
                               double rail, double cylinder, double low, double dt, double *figures);
extern int32_t cr_kernel_march(void *, void *, double *work, double *waves, int64_t ring, int64_t first, int64_t count,
                               const double *inputs, double dt);
extern int32_t cr_kernel_observe(void *, void *, const double *work, double *channels);
extern int32_t cr_kernel_figures(void *, void *, const double *work, double cylinder, double *figures);
extern int32_t cr_kernel_medium(void *, void *, const double *fuel, double pressure, double *medium);

typedef struct cr_head { /* plain data: a copy of its bytes is a copy of the simulation */
    uint64_t stamp;
    int64_t size, ring, steps;
    int32_t status, energisings, on, spare;
    double dt, start, density, rail, cylinder, borne, medium[3];
    double from[CR_ENERGISINGS], until[CR_ENERGISINGS];
    double figures[CR_KERNEL_FIGURES];
    double parameters[CR_PARAMETERS];
} cr_head;
typedef char cr_head_fits[sizeof(cr_head) <= CR_HEAD ? 1 : -1];

/* The functions of the header on a head, working rows and waves wherever they are; a block of injectors uses them too. */
int64_t cr_core_ring(const double *parameters, double dt); /* slots of a ring buffer; 0: too many */
int cr_core_boundary(const cr_boundary *boundary);
int cr_core_begin(cr_head *h, double *work, double *waves, const double *parameters, const cr_boundary *at_rest,
                  double dt, double start, int64_t ring);
int cr_core_plan(cr_head *h, const cr_energising *energisings, int count);
/* The working rows are `stride` numbers apart. */
int cr_core_switch(cr_head *h, double *work, int stride, double time, int on);
int cr_core_march(cr_head *h, double *work, double *waves, int64_t steps, const cr_boundary *boundary);
int cr_core_march_inputs(cr_head *h, double *work, double *waves, int64_t steps, const cr_inputs *inputs);
/* Clocks of the energisings in the next steps, those of one step and of the following `stride` numbers apart. */
void cr_core_clocks(const cr_head *h, int64_t count, double *since_start, double *since_end, int stride);
int cr_core_look(cr_head *h, const double *figures); /* keeps the failure that the figures show, if any */
int cr_core_status(const cr_head *h, const double *work);
void cr_core_observe(const cr_head *h, const double *work, double *channels);
void cr_core_figures(const cr_head *h, const double *work, cr_figures *out);
/* A block's beginning in parts: its own numbers, then each of all lanes, those without an injector as its last one. */
void cr_block_open(void *block, int64_t ring, int count, int vectors, double dt);
int cr_block_put(void *block, int lane, const double *parameters, const cr_boundary *at_rest);
/* Working rows of an injector of a block, `stride` numbers apart. */
const double *cr_block_rows(const void *block, int injector, int *stride);

/* Numbers too small for their format are zero, as in commonrail: a processor takes a hundred cycles for each. */
#if defined(__x86_64__) || defined(_M_X64)
typedef unsigned cr_mode;
static inline cr_mode cr_flush_tiny(void) {
    cr_mode before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u);
    return before;
}
static inline void cr_restore(cr_mode before) { _mm_setcsr(before); }
#elif defined(__aarch64__) && defined(__GNUC__)
typedef uint64_t cr_mode;
static inline cr_mode cr_flush_tiny(void) {
    cr_mode before;
    __asm__ volatile("mrs %0, fpcr" : "=r"(before));
    __asm__ volatile("msr fpcr, %0" : : "r"(before | (UINT64_C(1) << 24)));
    return before;
}
static inline void cr_restore(cr_mode before) { __asm__ volatile("msr fpcr, %0" : : "r"(before)); }
#else
typedef int cr_mode;
static inline cr_mode cr_flush_tiny(void) { return 0; }
static inline void cr_restore(cr_mode before) { (void)before; }
#endif
#endif
