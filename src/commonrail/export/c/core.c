/* Simulation of one injector around the compiled entries: checks, fuel, clock of the energisings, status. */
#include "cr_model.h"
#include "cr_commonrail.h"
#include <math.h>
#include <string.h>
#if defined(__x86_64__) || defined(_M_X64)
#include <xmmintrin.h>
#endif

#define CHUNK 32 /* steps whose inputs are on the stack at once */

/* Convention of the compiled entries: place of a result, place of an exception, which is never written, arguments. */
extern int32_t cr_kernel_begin(void *, void *, double *work, double *waves, int64_t ring, const double *theta,
                               double rail, double cylinder, double low, double dt, double *figures);
extern int32_t cr_kernel_march(void *, void *, double *work, double *waves, int64_t ring, int64_t first, int64_t count,
                               const double *inputs, double dt);
extern int32_t cr_kernel_observe(void *, void *, const double *work, double *channels);
extern int32_t cr_kernel_figures(void *, void *, const double *work, double cylinder, double *figures);
extern int32_t cr_kernel_medium(void *, void *, const double *fuel, double pressure, double *medium);

typedef struct { /* plain data: a copy of its bytes is a copy of the simulation */
    uint64_t stamp;
    int64_t size, ring, steps;
    int32_t status, energisings, on, spare;
    double dt, start, density, rail, cylinder, borne, medium[3];
    double from[CR_ENERGISINGS], until[CR_ENERGISINGS];
    double figures[CR_KERNEL_FIGURES];
    double parameters[CR_PARAMETERS];
} Head;

/* Numbers too small for their format are zero, as in commonrail: a processor takes a hundred cycles for each. */
#if defined(__x86_64__) || defined(_M_X64)
typedef unsigned Mode;
static Mode flush_tiny(void) {
    Mode before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u);
    return before;
}
static void restore(Mode before) { _mm_setcsr(before); }
#elif defined(__aarch64__) && defined(__GNUC__)
typedef uint64_t Mode;
static Mode flush_tiny(void) {
    Mode before;
    __asm__ volatile("mrs %0, fpcr" : "=r"(before));
    __asm__ volatile("msr fpcr, %0" : : "r"(before | (UINT64_C(1) << 24)));
    return before;
}
static void restore(Mode before) { __asm__ volatile("msr fpcr, %0" : : "r"(before)); }
#else
typedef int Mode;
static Mode flush_tiny(void) { return 0; }
static void restore(Mode before) { (void)before; }
#endif

static double *work_of(void *state) { return (double *)((char *)state + CR_HEAD); }
static const double *work_in(const void *state) { return (const double *)((const char *)state + CR_HEAD); }
static double *waves_of(void *state) { return work_of(state) + CR_WORK; }
typedef char head_fits[sizeof(Head) <= CR_HEAD ? 1 : -1];

const char *cr_parameter_name(int index) {
    return index >= 0 && index < CR_PARAMETERS ? cr_parameters[index].name : NULL;
}
const char *cr_parameter_unit(int index) {
    return index >= 0 && index < CR_PARAMETERS ? cr_parameters[index].unit : NULL;
}
int cr_parameter_index(const char *name) {
    for (int i = 0; name && i < CR_PARAMETERS; i++)
        if (!strcmp(cr_parameters[i].name, name)) return i;
    return -1;
}
void cr_defaults(double parameters[CR_PARAMETERS]) {
    for (int i = 0; i < CR_PARAMETERS; i++) parameters[i] = cr_parameters[i].value;
}
const char *cr_channel_name(int index) {
    return index >= 0 && index < CR_CHANNELS ? cr_channels[index].name : NULL;
}
const char *cr_channel_unit(int index) {
    return index >= 0 && index < CR_CHANNELS ? cr_channels[index].unit : NULL;
}

/* First parameter outside its domain, or -1. */
static int outside(const double *parameters) {
    for (int i = 0; i < CR_PARAMETERS; i++) {
        const cr_parameter *p = cr_parameters + i;
        double v = parameters[i];
        int above = p->low_open ? v > p->low : v >= p->low, below = p->high_open ? v < p->high : v <= p->high;
        if (!above || !below || !isfinite(v)) return i;
    }
    return -1;
}
static int good_step(double dt) { return dt >= CR_SHORTEST_STEP && dt <= CR_LONGEST_STEP; }

/* Slots of a ring buffer: a power of two above the longest delay. */
static int64_t ring_of(const double *parameters, double dt) {
    double longest = cr_longest_way(parameters) / CR_SLOWEST_WAVE / dt + 4.0;
    int64_t ring = 1;
    if (!(longest < CR_MOST_SLOTS)) return 0;
    while ((double)ring < longest) ring *= 2;
    return ring;
}

/* Coefficients of the fuel at a temperature: Chebyshev series by Clenshaw's scheme. */
static void fuel_at(double temperature, double *fuel) {
    double x = (2.0 * temperature - CR_COLDEST - CR_HOTTEST) / (CR_HOTTEST - CR_COLDEST);
    for (int i = 0; i < CR_FUEL; i++) {
        double b1 = 0.0, b2 = 0.0;
        for (int k = CR_DEGREE; k > 0; k--) {
            double b0 = 2.0 * x * b1 - b2 + cr_fuel[i][k];
            b2 = b1;
            b1 = b0;
        }
        fuel[i] = x * b1 - b2 + cr_fuel[i][0];
    }
}

static int check_boundary(const cr_boundary *b) {
    const double low = CR_LOWEST_PRESSURE * (1.0 - 1e-9), high = CR_HIGHEST_PRESSURE * (1.0 + 1e-9);
    double p[3];
    if (!b) return CR_BAD_BOUNDARY;
    p[0] = b->rail_pressure, p[1] = b->cylinder_pressure, p[2] = b->return_pressure;
    for (int i = 0; i < 3; i++)
        if (!(p[i] >= low && p[i] <= high) || (i && !(p[i] < p[0]))) return CR_BAD_BOUNDARY;
    return isfinite(b->drive) ? CR_OK : CR_BAD_BOUNDARY;
}

/* Fuel at the largest pressure, which decides how long a step may be: bulk modulus, sound speed, that in the return. */
static void medium_at(const double *parameters, const cr_boundary *at_rest, double *medium) {
    double fuel[CR_FUEL], found[3];
    void *result[2];
    fuel_at(parameters[CR_PARAMETERS - 1], fuel);
    cr_kernel_medium(result, result + 1, fuel, 0.5e6, found);
    medium[2] = found[2];
    cr_kernel_medium(result, result + 1, fuel, at_rest->rail_pressure, found);
    medium[0] = found[1];
    medium[1] = found[2];
}

int cr_check(const double parameters[CR_PARAMETERS], const cr_boundary *at_rest, double time_step, int *wrong) {
    double medium[3];
    int bad = outside(parameters), status = check_boundary(at_rest);
    if (wrong) *wrong = bad;
    if (bad >= 0 || !good_step(time_step) || !ring_of(parameters, time_step)) return CR_OUTSIDE_DOMAIN;
    if (status) return status;
    medium_at(parameters, at_rest, medium);
    return cr_bears(parameters, 0.0, medium, time_step) ? CR_OK : CR_STEP_UNSTABLE;
}

double cr_longest_step(const double parameters[CR_PARAMETERS], const cr_boundary *at_rest) {
    double medium[3], low = 1e-15, high = 1.0;
    if (outside(parameters) >= 0 || check_boundary(at_rest)) return 0.0;
    medium_at(parameters, at_rest, medium);
    if (!cr_bears(parameters, 0.0, medium, low)) return 0.0;
    for (int i = 0; i < 60; i++) {
        double middle = sqrt(low * high);
        if (cr_bears(parameters, 0.0, medium, middle))
            low = middle;
        else
            high = middle;
    }
    return low;
}

size_t cr_state_size(const double parameters[CR_PARAMETERS], double time_step) {
    int64_t ring = outside(parameters) < 0 && good_step(time_step) ? ring_of(parameters, time_step) : 0;
    int64_t slots = 3 * ring > CR_COLUMNS ? 3 * ring : CR_COLUMNS;
    return ring ? CR_HEAD + (size_t)(CR_WORK + slots) * sizeof(double) : 0;
}

int cr_begin(void *state, size_t size, const double parameters[CR_PARAMETERS], const cr_boundary *at_rest,
             double time_step, double start) {
    double theta[CR_COLUMNS], found[3];
    void *result[2];
    Head *h = state;
    size_t needed = cr_state_size(parameters, time_step);
    if (!needed || !isfinite(start)) return CR_OUTSIDE_DOMAIN;
    if (!state || size < needed) return CR_BAD_MEMORY;
    int status = check_boundary(at_rest);
    if (status) return status;
    memset(state, 0, needed);
    h->stamp = CR_STAMP;
    h->size = (int64_t)needed;
    h->ring = ring_of(parameters, time_step);
    h->dt = time_step;
    h->start = start;
    h->rail = at_rest->rail_pressure;
    h->cylinder = at_rest->cylinder_pressure;
    memcpy(h->parameters, parameters, sizeof h->parameters);
    memcpy(theta, parameters, (CR_PARAMETERS - 1) * sizeof(double));
    fuel_at(parameters[CR_PARAMETERS - 1], theta + CR_PARAMETERS - 1);
    cr_kernel_medium(result, result + 1, theta + CR_PARAMETERS - 1, at_rest->cylinder_pressure, found);
    h->density = found[0];
    medium_at(parameters, at_rest, h->medium);
    Mode mode = flush_tiny();
    cr_kernel_begin(result, result + 1, work_of(state), waves_of(state), h->ring, theta, at_rest->rail_pressure,
                    at_rest->cylinder_pressure, at_rest->return_pressure, time_step, h->figures);
    restore(mode);
    if (!cr_bears(parameters, 0.0, h->medium, time_step)) h->status = CR_STEP_UNSTABLE;
    if (h->figures[CR_F_CLOSED_AT_START] == 0.0) h->status = CR_NOT_CLOSED_AT_START;
    return h->status;
}

static Head *head(void *state) {
    Head *h = state;
    return h && h->stamp == CR_STAMP ? h : NULL;
}

int cr_plan(void *state, const cr_energising *energisings, int count) {
    Head *h = head(state);
    if (!h) return CR_BAD_MEMORY;
    double ends = cr_time(state) - 1e-9 * h->dt;
    if (count < 0 || count > CR_ENERGISINGS || (count && !energisings)) return CR_BAD_PLAN;
    for (int i = 0; i < count; i++) {
        const cr_energising *e = energisings + i;
        if (!(e->start >= ends) || !(e->duration >= 0.0) || !isfinite(e->start + e->duration)) return CR_BAD_PLAN;
        ends = e->start + e->duration;
    }
    for (int i = 0; i < count; i++) {
        h->from[i] = energisings[i].start;
        h->until[i] = energisings[i].start + energisings[i].duration;
    }
    h->energisings = count;
    h->on = 0;
    return CR_OK;
}

int cr_switch(void *state, double time, int on) {
    Head *h = head(state);
    if (!h) return CR_BAD_MEMORY;
    if ((on != 0) == h->on) return CR_OK;
    int last = h->energisings - 1;
    if (!(time >= cr_time(state) - 1e-6 * h->dt) || !isfinite(time)) return CR_BAD_PLAN;
    if (!on) {
        if (!(time >= h->from[last])) return CR_BAD_PLAN;
        h->until[last] = time;
    } else {
        if (last >= 0 && !(time >= h->until[last])) return CR_BAD_PLAN;
        if (h->energisings == CR_ENERGISINGS) { /* the oldest one is over */
            memmove(h->from, h->from + 1, (size_t)last * sizeof(double));
            memmove(h->until, h->until + 1, (size_t)last * sizeof(double));
            h->energisings--;
        }
        h->from[h->energisings] = time;
        h->until[h->energisings++] = HUGE_VAL;
        double *work = work_of(state);
        if (work[CR_ROW_CLEAR] == 0.0) /* the needle is closed: the instants will be those of this injection */
            work[CR_ROW_OPENED] = work[CR_ROW_SHUT] = work[CR_ROW_FIRST_SHUT] = 0.0;
    }
    h->on = on != 0;
    return CR_OK;
}

/* Clock of the energisings in the step that begins at a time. A step that sees one energising end and the next begin is
 * energised for as long as both together: the next counts as begun so much earlier. */
static void clock_at(const Head *h, double begin, cr_inputs *in) {
    int now = 0;
    double lasting = 0.0;
    in->since_start = in->since_end = -1.0;
    if (!h->energisings) return;
    for (int i = 1; i < h->energisings; i++)
        if (h->from[i] < begin + h->dt * (1.0 - 1e-9)) now = i;
    for (int i = 0; i < now; i++) {
        double until = h->until[i] < begin + h->dt ? h->until[i] : begin + h->dt;
        double from = h->from[i] > begin ? h->from[i] : begin;
        if (until > from) lasting += until - from;
    }
    in->since_start = begin - h->from[now] + lasting;
    in->since_end = h->until[now] < HUGE_VAL ? begin - h->until[now] : -1.0;
}

/* Failure of the present state, or CR_OK. The step was short enough up to a lift `borne`. */
static int failure(const Head *h, const double *figures, double borne) {
    double lift = figures[CR_F_GREATEST_LIFT];
    if (h->figures[CR_F_CLOSED_AT_START] == 0.0) return CR_NOT_CLOSED_AT_START;
    if (!(lift <= borne) && !cr_bears(h->parameters, isfinite(lift) ? lift : 0.0, h->medium, h->dt))
        return CR_STEP_UNSTABLE;
    if (figures[CR_F_INJECTED] < -CR_BACKFLOW) return CR_NOT_FINITE;
    if (figures[CR_F_SOUND] == 0.0) return isfinite(figures[CR_F_INJECTED]) ? CR_RAN_AWAY : CR_NOT_FINITE;
    return CR_OK;
}
static int look(Head *h, const void *state) {
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    cr_kernel_figures(result, result + 1, work_in(state), h->cylinder, figures);
    int failed = failure(h, figures, h->borne);
    if (!failed) h->borne = figures[CR_F_GREATEST_LIFT];
    return failed;
}

static void advance(Head *h, void *state, int64_t count, const cr_inputs *inputs) {
    void *result[2];
    Mode mode = flush_tiny();
    cr_kernel_march(result, result + 1, work_of(state), waves_of(state), h->ring, h->steps, count, &inputs->rail, h->dt);
    restore(mode);
    h->steps += count;
    h->rail = inputs[count - 1].rail;
    h->cylinder = inputs[count - 1].cylinder;
}

int cr_march_inputs(void *state, int64_t steps, const cr_inputs *inputs) {
    Head *h = head(state);
    if (!h) return CR_BAD_MEMORY;
    while (steps > 0 && !h->status) {
        int64_t count = CHUNK - h->steps % CHUNK;
        if (count > steps) count = steps;
        advance(h, state, count, inputs);
        if (h->steps % CHUNK == 0) h->status = look(h, state);
        inputs += count;
        steps -= count;
    }
    return h->status;
}

int cr_march(void *state, int64_t steps, const cr_boundary *boundary) {
    cr_inputs inputs[CHUNK];
    Head *h = head(state);
    if (!h) return CR_BAD_MEMORY;
    int status = check_boundary(boundary);
    if (status) return status;
    while (steps > 0 && !h->status) {
        int64_t count = CHUNK - h->steps % CHUNK;
        if (count > steps) count = steps;
        for (int64_t n = 0; n < count; n++) {
            cr_inputs *in = inputs + n;
            in->rail = boundary->rail_pressure;
            in->cylinder = boundary->cylinder_pressure;
            in->low = boundary->return_pressure;
            in->trace = boundary->drive;
            clock_at(h, h->start + h->dt * (double)(h->steps + n), in);
        }
        cr_march_inputs(state, count, inputs);
        steps -= count;
    }
    return h->status;
}

double cr_time(const void *state) {
    const Head *h = state;
    return h->start + h->dt * (double)h->steps;
}
int64_t cr_steps(const void *state) { return ((const Head *)state)->steps; }

int cr_status(const void *state) {
    const Head *h = state;
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    if (!h || h->stamp != CR_STAMP) return CR_BAD_MEMORY;
    if (h->status) return h->status;
    cr_kernel_figures(result, result + 1, work_in(state), h->cylinder, figures);
    int failed = failure(h, figures, h->borne);
    return failed ? failed : figures[CR_F_CLOSED_AT_END] == 0.0 ? CR_STILL_INJECTING : CR_OK;
}

void cr_observe(const void *state, double channels[CR_CHANNELS]) {
    void *result[2];
    cr_kernel_observe(result, result + 1, work_in(state), channels);
#ifdef CR_IDEAL_RAIL
    channels[CR_IDEAL_RAIL] = ((const Head *)state)->rail;
#endif
}

void cr_read_figures(const void *state, cr_figures *out) {
    const Head *h = state;
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    cr_kernel_figures(result, result + 1, work_in(state), h->cylinder, figures);
    out->injected = figures[CR_F_INJECTED];
    out->returned = figures[CR_F_RETURNED];
    out->supplied = figures[CR_F_SUPPLIED];
    out->opening = h->start + h->dt * figures[CR_F_OPENING];
    out->closing = h->start + h->dt * figures[CR_F_CLOSING];
    out->first_closing = h->start + h->dt * figures[CR_F_FIRST_CLOSING];
    out->greatest_lift = figures[CR_F_GREATEST_LIFT];
    out->reference_density = h->density;
}

const char *cr_sentence(int status) {
    for (int i = 0; i < CR_SENTENCES; i++)
        if (cr_sentences[i].status == status) return cr_sentences[i].text;
    return "There is no such status.";
}
