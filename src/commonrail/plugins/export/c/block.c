/* Blocks of injectors: one in each lane of vector registers where the processor has them, else one after another. */
#include "cr_core.h"
#include "cr_block.h"
#include <math.h>
#include <string.h>
#if defined(CR_VECTORS) && defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>
#define CR_COMPILED_VECTORS
#endif

#define FIELDS ((int)(sizeof(cr_inputs) / sizeof(double)))
#define BLOCK_HEAD 256 /* bytes */
#define BLOCK_STAMP (~CR_STAMP)

/* Memory: this head; a cr_head for each injector; working rows; waves; working rows of those that have failed; scratch
 * in which an injector begins. In vectors a row has the numbers of all lanes, else each injector has its rows. */
typedef struct {
    uint64_t stamp;
    int64_t size, ring, steps;
    int32_t count, vectors, alike, begun;
    double dt, start;
} Block;
typedef char block_fits[sizeof(Block) <= BLOCK_HEAD ? 1 : -1];

typedef struct { /* places of one injector's numbers; the rows are `stride` apart */
    cr_head *head;
    double *work, *waves, *still;
    int stride;
} Lane;

static int64_t slots_of(int64_t ring) { return 3 * ring > CR_COLUMNS ? 3 * ring : CR_COLUMNS; }

static Lane lane_of(void *block, int i) {
    const Block *b = block;
    Lane lane;
    char *heads = (char *)block + BLOCK_HEAD;
    double *work = (double *)(heads + (size_t)CR_LANES * CR_HEAD), *waves = work + CR_LANES * CR_WORK;
    lane.head = (cr_head *)(heads + (size_t)i * CR_HEAD);
    lane.still = waves + CR_LANES * slots_of(b->ring) + (size_t)i * CR_WORK;
    lane.stride = b->vectors > 1 ? CR_LANES : 1;
    lane.work = b->vectors > 1 ? work + i : work + (size_t)i * CR_WORK;
    lane.waves = b->vectors > 1 ? waves + i : waves + (int64_t)i * slots_of(b->ring);
    return lane;
}

#ifdef CR_COMPILED_VECTORS
typedef int32_t March(void *, void *, double *work, double *waves, int64_t ring, int64_t first, int64_t count,
                      const double *inputs, double dt, int64_t alike);
typedef int32_t Report(void *, void *, double *work, double *figures);
extern March cr_kernel_block_avx2, cr_kernel_block_avx512;
extern Report cr_kernel_block_figures_avx2, cr_kernel_block_figures_avx512;

static int has(unsigned found, unsigned wanted) { return (found & wanted) == wanted; }

int cr_vectors(void) {
    unsigned a, b, c, d, kept;
    /* FMA, SSE4.2, MOVBE, POPCNT, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT: those of x86-64-v3 */
    if (!__get_cpuid(1, &a, &b, &c, &d) || !has(c, 1u << 12 | 1u << 20 | 1u << 22 | 1u << 23 | 7u << 27)) return 1;
    __asm__ volatile("xgetbv" : "=a"(kept), "=d"(d) : "c"(0)); /* registers that the system keeps for a thread */
    if (!has(kept, 0x6) || !__get_cpuid(0x80000001, &a, &b, &c, &d) || !has(c, 1u << 5)) return 1;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || !has(b, 1u << 3 | 1u << 5 | 1u << 8)) return 1;
    /* AVX-512 F, DQ, CD, BW, VL: those of x86-64-v4 */
    return has(kept, 0xe6) && has(b, 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31) ? 8 : 4;
}

/* Checks the health of all injectors; what one that has failed was like is kept. */
static void look(Block *b) {
    double figures[CR_LANES * CR_KERNEL_FIGURES];
    void *result[2];
    Lane first = lane_of(b, 0);
    Report *report = b->vectors == 8 ? cr_kernel_block_figures_avx512 : cr_kernel_block_figures_avx2;
    report(result, result + 1, first.work, figures);
    for (int i = 0; i < b->count; i++) {
        Lane lane = lane_of(b, i);
        if (lane.head->status || !cr_core_look(lane.head, figures + i * CR_KERNEL_FIGURES)) continue;
        for (int row = 0; row < CR_WORK; row++) lane.still[row] = lane.work[row * lane.stride];
    }
}

/* Some steps of all lanes, not beyond the next check of their health; `inputs`: (steps, fields, lanes). */
static void advance(Block *b, int64_t count, const double *inputs) {
    void *result[2];
    Lane first = lane_of(b, 0);
    const double *last = inputs + (count - 1) * FIELDS * CR_LANES;
    March *march = b->vectors == 8 ? cr_kernel_block_avx512 : cr_kernel_block_avx2;
    cr_mode mode = cr_flush_tiny();
    march(result, result + 1, first.work, first.waves, b->ring, b->steps, count, inputs, b->dt, b->alike);
    cr_restore(mode);
    b->steps += count;
    for (int i = 0; i < b->count; i++) {
        cr_head *h = lane_of(b, i).head;
        if (h->status) continue;
        h->steps = b->steps;
        h->rail = last[i];
        h->cylinder = last[CR_LANES + i];
    }
    if (b->steps % CHUNK == 0) look(b);
}

static void march_lanes(Block *b, int64_t steps, const cr_boundary *boundaries, const cr_inputs *inputs) {
    double table[CHUNK][FIELDS][CR_LANES];
    for (int lane = 0; boundaries && lane < CR_LANES; lane++) { /* lanes without an injector do as the last one does */
        const cr_boundary *own = boundaries + (lane < b->count ? lane : b->count - 1);
        for (int64_t n = 0; n < CHUNK && n < steps; n++) {
            table[n][0][lane] = own->rail_pressure;
            table[n][1][lane] = own->cylinder_pressure;
            table[n][2][lane] = own->return_pressure;
            table[n][3][lane] = own->drive;
        }
    }
    while (steps > 0) {
        int64_t count = CHUNK - b->steps % CHUNK;
        if (count > steps) count = steps;
        for (int lane = 0; lane < CR_LANES; lane++) {
            int i = lane < b->count ? lane : b->count - 1;
            if (inputs)
                for (int64_t n = 0; n < count; n++)
                    for (int field = 0; field < FIELDS; field++)
                        table[n][field][lane] = (&inputs[n * b->count + i].rail)[field];
            else
                cr_core_clocks(lane_of(b, i).head, count, &table[0][4][lane], &table[0][5][lane], FIELDS * CR_LANES);
        }
        advance(b, count, &table[0][0][0]);
        if (inputs) inputs += count * b->count;
        steps -= count;
    }
}

/* Puts an injector that has begun in scratch memory into a lane. */
static void put(const Block *b, Lane lane, const double *work, const double *waves) {
    for (int row = 0; row < CR_WORK; row++) lane.work[row * CR_LANES] = work[row];
    for (int64_t slot = 0; slot < slots_of(b->ring); slot++) lane.waves[slot * CR_LANES] = waves[slot];
}
#else
int cr_vectors(void) { return 1; }
static void march_lanes(Block *b, int64_t steps, const cr_boundary *boundaries, const cr_inputs *inputs) {
    (void)b, (void)steps, (void)boundaries, (void)inputs;
}
static void put(const Block *b, Lane lane, const double *work, const double *waves) {
    (void)b, (void)lane, (void)work, (void)waves;
}
#endif

/* Slots of a ring buffer that holds the waves of all injectors; 0 where there can be none. */
static int64_t ring_of_all(const double *parameters, int count, double time_step) {
    int64_t ring = 0;
    if (!parameters || count < 1 || count > CR_LANES) return 0;
    for (int i = 0; i < count; i++) {
        const double *own = parameters + i * CR_PARAMETERS;
        int64_t wanted = cr_state_size(own, time_step) ? cr_core_ring(own, time_step) : 0;
        if (!wanted) return 0;
        if (wanted > ring) ring = wanted;
    }
    return ring;
}

size_t cr_block_size(const double *parameters, int count, double time_step) {
    int64_t ring = ring_of_all(parameters, count, time_step);
    int64_t lanes = CR_LANES * (CR_WORK + slots_of(ring)), still = CR_LANES * CR_WORK, scratch = CR_WORK + slots_of(ring);
    if (!ring) return 0;
    return BLOCK_HEAD + (size_t)CR_LANES * CR_HEAD + (size_t)(lanes + still + scratch) * sizeof(double);
}

int cr_block_begin(void *block, size_t size, const double *parameters, const cr_boundary *at_rest, int count,
                   int vectors, double time_step, double start) {
    Block *b = block;
    size_t needed = cr_block_size(parameters, count, time_step);
    int found = cr_vectors(), first = CR_OK;
    if (!needed || !isfinite(start)) return CR_OUTSIDE_DOMAIN;
    if (!block || size < needed) return CR_BAD_MEMORY;
    for (int i = 0; i < count; i++) {
        int status = at_rest ? cr_core_boundary(at_rest + i) : CR_BAD_BOUNDARY;
        if (status) return status;
    }
    memset(block, 0, needed);
    b->size = (int64_t)needed;
    b->ring = ring_of_all(parameters, count, time_step);
    b->vectors = vectors > 0 && vectors < found ? (vectors < 4 ? 1 : 4) : found;
    b->start = start;
    cr_block_open(block, b->ring, count, b->vectors, time_step);
    for (int i = 0; i < CR_LANES; i++) {
        int own = i < count ? i : count - 1;
        int status = cr_block_put(block, i, parameters + own * CR_PARAMETERS, at_rest + own);
        if (!first) first = status;
    }
    return first;
}

void cr_block_open(void *block, int64_t ring, int count, int vectors, double dt) {
    Block *b = block;
    b->stamp = BLOCK_STAMP;
    b->ring = ring;
    b->steps = 0;
    b->dt = dt;
    b->count = count;
    b->vectors = vectors;
    b->alike = 1;
}

int cr_block_put(void *block, int i, const double *parameters, const cr_boundary *at_rest) {
    Block *b = block;
    Lane lane = lane_of(block, i), zeroth = lane_of(block, 0);
    int together = b->vectors > 1;
    double *scratch = lane_of(block, CR_LANES).still; /* behind what stands still */
    if (!together && i >= b->count) return CR_OK;
    int status = cr_core_begin(lane.head, together ? scratch : lane.work, together ? scratch + CR_WORK : lane.waves,
                               parameters, at_rest, b->dt, b->start, b->ring);
    if (together) put(b, lane, scratch, scratch + CR_WORK);
    for (int wave = 0; wave < 3; wave++) {
        int row = (CR_ROW_DELAY_STEPS + wave) * lane.stride;
        b->alike &= lane.work[row] == zeroth.work[row];
    }
    for (int row = 0; row < CR_WORK; row++) lane.still[row] = lane.work[row * lane.stride];
    return status;
}

static Block *begun(const void *block) {
    Block *b = (Block *)block;
    return b && b->stamp == BLOCK_STAMP ? b : NULL;
}
static Block *begun_with(const void *block, int injector) {
    Block *b = begun(block);
    return b && injector >= 0 && injector < b->count ? b : NULL;
}

int cr_block_vectors(const void *block) { return begun(block) ? begun(block)->vectors : 0; }
int cr_block_count(const void *block) { return begun(block) ? begun(block)->count : 0; }
double cr_block_time(const void *block) {
    const Block *b = begun(block);
    return b ? b->start + b->dt * (double)b->steps : NAN;
}

int cr_block_plan(void *block, int injector, const cr_energising *energisings, int count) {
    return begun_with(block, injector) ? cr_core_plan(lane_of(block, injector).head, energisings, count) : CR_BAD_MEMORY;
}
int cr_block_switch(void *block, int injector, double time, int on) {
    if (!begun_with(block, injector)) return CR_BAD_MEMORY;
    Lane lane = lane_of(block, injector);
    return cr_core_switch(lane.head, lane.work, lane.stride, time, on);
}

static int march(Block *b, int64_t steps, const cr_boundary *boundaries, const cr_inputs *inputs) {
    int first = CR_OK;
    if (b->vectors > 1)
        march_lanes(b, steps, boundaries, inputs);
    else
        for (int i = 0; i < b->count; i++) {
            Lane lane = lane_of(b, i);
            if (!inputs) cr_core_march(lane.head, lane.work, lane.waves, steps, boundaries + i);
            for (int64_t n = 0; inputs && n < steps; n++)
                cr_core_march_inputs(lane.head, lane.work, lane.waves, 1, inputs + n * b->count + i);
        }
    if (b->vectors == 1 && steps > 0) b->steps += steps;
    for (int i = b->count - 1; i >= 0; i--)
        if (lane_of(b, i).head->status) first = lane_of(b, i).head->status;
    return first;
}

int cr_block_march(void *block, int64_t steps, const cr_boundary *boundaries) {
    Block *b = begun(block);
    if (!b) return CR_BAD_MEMORY;
    for (int i = 0; i < b->count; i++) {
        int status = boundaries ? cr_core_boundary(boundaries + i) : CR_BAD_BOUNDARY;
        if (status) return status;
    }
    return march(b, steps, boundaries, NULL);
}
int cr_block_march_inputs(void *block, int64_t steps, const cr_inputs *inputs) {
    Block *b = begun(block);
    return b && inputs ? march(b, steps, NULL, inputs) : CR_BAD_MEMORY;
}

const double *cr_block_rows(const void *block, int injector, int *stride) {
    Lane lane = lane_of((void *)block, injector);
    *stride = lane.stride;
    return lane.work;
}

/* Working rows of an injector as it has them alone. */
static const double *alone(const void *block, int injector, double *room) {
    Lane lane = lane_of((void *)block, injector);
    if (lane.stride == 1) return lane.work;
    if (lane.head->status) return lane.still;
    for (int row = 0; row < CR_WORK; row++) room[row] = lane.work[row * lane.stride];
    return room;
}

int cr_block_status(const void *block, int injector) {
    double room[CR_WORK];
    if (!begun_with(block, injector)) return CR_BAD_MEMORY;
    return cr_core_status(lane_of((void *)block, injector).head, alone(block, injector, room));
}
void cr_block_observe(const void *block, int injector, double channels[CR_CHANNELS]) {
    double room[CR_WORK];
    if (begun_with(block, injector))
        cr_core_observe(lane_of((void *)block, injector).head, alone(block, injector, room), channels);
}
void cr_block_read_figures(const void *block, int injector, cr_figures *figures) {
    double room[CR_WORK];
    if (begun_with(block, injector))
        cr_core_figures(lane_of((void *)block, injector).head, alone(block, injector, room), figures);
}
