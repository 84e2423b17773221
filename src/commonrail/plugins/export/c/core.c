/* Simulation of one injector around the compiled entries: checks, fuel, clock of the energisings, status. */
#include "cr_core.h"
#include "cr_model.h"
#include <math.h>
#include <string.h>

static double *work_of(void *state) { return (double *)((char *)state + CR_HEAD); }
static const double *work_in(const void *state) { return (const double *)((const char *)state + CR_HEAD); }
static double *waves_of(void *state) { return work_of(state) + CR_WORK; }

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
int64_t cr_core_ring(const double *parameters, double dt) {
    double longest = cr_longest_way(parameters) / CR_SLOWEST_WAVE / dt + 4.0;
    int64_t ring = 1;
    if (!(longest < CR_MOST_SLOTS)) return 0;
    while ((double)ring < longest) ring *= 2;
    return ring;
}

/* Coefficients of the fuel at a temperature: Chebyshev series by Clenshaw's scheme, at the model's own no series. */
static void fuel_at(double temperature, double *fuel) {
    for (int i = 0; i < CR_KNOWN; i++)
        if (temperature == cr_known_fuel[i][0]) {
            memcpy(fuel, cr_known_fuel[i] + 1, CR_FUEL * sizeof(double));
            return;
        }
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

int cr_core_boundary(const cr_boundary *b) {
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
    int bad = outside(parameters), status = cr_core_boundary(at_rest);
    if (wrong) *wrong = bad;
    if (bad >= 0 || !good_step(time_step) || !cr_core_ring(parameters, time_step)) return CR_OUTSIDE_DOMAIN;
    if (status) return status;
    medium_at(parameters, at_rest, medium);
    return cr_bears(parameters, 0.0, medium, time_step) ? CR_OK : CR_STEP_UNSTABLE;
}

double cr_longest_step(const double parameters[CR_PARAMETERS], const cr_boundary *at_rest) {
    double medium[3], low = 1e-15, high = 1.0;
    if (outside(parameters) >= 0 || cr_core_boundary(at_rest)) return 0.0;
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
    int64_t ring = outside(parameters) < 0 && good_step(time_step) ? cr_core_ring(parameters, time_step) : 0;
    int64_t slots = 3 * ring > CR_COLUMNS ? 3 * ring : CR_COLUMNS;
    return ring ? CR_HEAD + (size_t)(CR_WORK + slots) * sizeof(double) : 0;
}

int cr_core_begin(cr_head *h, double *work, double *waves, const double *parameters, const cr_boundary *at_rest,
                  double dt, double start, int64_t ring) {
    double theta[CR_COLUMNS], found[3];
    void *result[2];
    memset(h, 0, sizeof *h);
    h->stamp = CR_STAMP;
    h->ring = ring;
    h->dt = dt;
    h->start = start;
    h->rail = at_rest->rail_pressure;
    h->cylinder = at_rest->cylinder_pressure;
    memcpy(h->parameters, parameters, sizeof h->parameters);
    memcpy(theta, parameters, (CR_PARAMETERS - 1) * sizeof(double));
    fuel_at(parameters[CR_PARAMETERS - 1], theta + CR_PARAMETERS - 1);
    cr_kernel_medium(result, result + 1, theta + CR_PARAMETERS - 1, at_rest->cylinder_pressure, found);
    h->density = found[0];
    medium_at(parameters, at_rest, h->medium);
    cr_mode mode = cr_flush_tiny();
    cr_kernel_begin(result, result + 1, work, waves, ring, theta, at_rest->rail_pressure, at_rest->cylinder_pressure,
                    at_rest->return_pressure, dt, h->figures);
    cr_restore(mode);
    if (!cr_bears(parameters, 0.0, h->medium, dt)) h->status = CR_STEP_UNSTABLE;
    if (h->figures[CR_F_CLOSED_AT_START] == 0.0) h->status = CR_NOT_CLOSED_AT_START;
    return h->status;
}

int cr_begin(void *state, size_t size, const double parameters[CR_PARAMETERS], const cr_boundary *at_rest,
             double time_step, double start) {
    size_t needed = cr_state_size(parameters, time_step);
    if (!needed || !isfinite(start)) return CR_OUTSIDE_DOMAIN;
    if (!state || size < needed) return CR_BAD_MEMORY;
    int status = cr_core_boundary(at_rest);
    if (status) return status;
    memset(state, 0, needed);
    status = cr_core_begin(state, work_of(state), waves_of(state), parameters, at_rest, time_step, start,
                           cr_core_ring(parameters, time_step));
    ((cr_head *)state)->size = (int64_t)needed;
    return status;
}

static cr_head *head(void *state) {
    cr_head *h = state;
    return h && h->stamp == CR_STAMP ? h : NULL;
}
static double now_of(const cr_head *h) { return h->start + h->dt * (double)h->steps; }

int cr_core_plan(cr_head *h, const cr_energising *energisings, int count) {
    double ends = now_of(h) - 1e-9 * h->dt;
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
int cr_plan(void *state, const cr_energising *energisings, int count) {
    cr_head *h = head(state);
    return h ? cr_core_plan(h, energisings, count) : CR_BAD_MEMORY;
}

int cr_core_switch(cr_head *h, double *work, int stride, double time, int on) {
    int last = h->energisings - 1;
    if ((on != 0) == h->on) return CR_OK;
    if (!(time >= now_of(h) - 1e-6 * h->dt) || !isfinite(time)) return CR_BAD_PLAN;
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
        if (work[CR_ROW_IS_OPEN * stride] == 0.0) { /* the needle is closed: the instants will be those of this injection */
            work[CR_ROW_OPENING * stride] = work[CR_ROW_LAST_CLOSING * stride] = 0.0;
            work[CR_ROW_FIRST_CLOSING * stride] = 0.0;
        }
    }
    h->on = on != 0;
    return CR_OK;
}
int cr_switch(void *state, double time, int on) {
    cr_head *h = head(state);
    return h ? cr_core_switch(h, work_of(state), 1, time, on) : CR_BAD_MEMORY;
}

/* Clock of the energisings in the step that begins at a time. A step that sees one energising end and the next begin is
 * energised for as long as both together: the next counts as begun so much earlier. */
static void clock_at(const cr_head *h, double begin, double *since_start, double *since_end) {
    int now = 0;
    double lasting = 0.0;
    for (int i = 1; i < h->energisings; i++)
        if (h->from[i] < begin + h->dt * (1.0 - 1e-9)) now = i;
    for (int i = 0; i < now; i++) {
        double until = h->until[i] < begin + h->dt ? h->until[i] : begin + h->dt;
        double from = h->from[i] > begin ? h->from[i] : begin;
        if (until > from) lasting += until - from;
    }
    *since_start = begin - h->from[now] + lasting;
    *since_end = h->until[now] < HUGE_VAL ? begin - h->until[now] : -1.0;
}

/* The energising that counts in all steps of a time; -1 where one begins or ends near it. */
static int same_in(const cr_head *h, double begin, double end) {
    int now = 0;
    for (int i = 0; i < h->energisings; i++) {
        if (h->from[i] > begin && h->from[i] < end) return -1;
        if (h->until[i] > begin && h->until[i] < end) return -1;
        if (i && h->from[i] <= begin) now = i;
    }
    return now;
}

void cr_core_clocks(const cr_head *h, int64_t count, double *since_start, double *since_end, int stride) {
    double first = now_of(h) - h->dt;
    int now = same_in(h, first, first + h->dt * (double)(count + 2));
    for (int64_t n = 0; n < count; n++) {
        double begin = h->start + h->dt * (double)(h->steps + n);
        double *start = since_start + n * stride, *end = since_end + n * stride;
        if (!h->energisings) {
            *start = *end = -1.0;
        } else if (now < 0) {
            clock_at(h, begin, start, end);
        } else {
            *start = begin - h->from[now];
            *end = h->until[now] < HUGE_VAL ? begin - h->until[now] : -1.0;
        }
    }
}

/* Failure of the present state, or CR_OK. The step was short enough up to a lift h->borne. */
static int failure(const cr_head *h, const double *figures) {
    double lift = figures[CR_F_GREATEST_LIFT];
    if (h->figures[CR_F_CLOSED_AT_START] == 0.0) return CR_NOT_CLOSED_AT_START;
    if (!(lift <= h->borne) && !cr_bears(h->parameters, isfinite(lift) ? lift : 0.0, h->medium, h->dt))
        return CR_STEP_UNSTABLE;
    if (figures[CR_F_INJECTED] < -CR_BACKFLOW) return CR_NOT_FINITE;
    if (figures[CR_F_SOUND] == 0.0) return isfinite(figures[CR_F_INJECTED]) ? CR_RAN_AWAY : CR_NOT_FINITE;
    return CR_OK;
}
int cr_core_look(cr_head *h, const double *figures) {
    h->status = failure(h, figures);
    if (!h->status) h->borne = figures[CR_F_GREATEST_LIFT];
    return h->status;
}

static void advance(cr_head *h, double *work, double *waves, int64_t count, const cr_inputs *inputs) {
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    cr_mode mode = cr_flush_tiny();
    cr_kernel_march(result, result + 1, work, waves, h->ring, h->steps, count, &inputs->rail, h->dt);
    cr_restore(mode);
    h->steps += count;
    h->rail = inputs[count - 1].rail;
    h->cylinder = inputs[count - 1].cylinder;
    if (h->steps % CHUNK) return;
    cr_kernel_figures(result, result + 1, work, h->cylinder, figures);
    cr_core_look(h, figures);
}

int cr_core_march_inputs(cr_head *h, double *work, double *waves, int64_t steps, const cr_inputs *inputs) {
    while (steps > 0 && !h->status) {
        int64_t count = CHUNK - h->steps % CHUNK;
        if (count > steps) count = steps;
        advance(h, work, waves, count, inputs);
        inputs += count;
        steps -= count;
    }
    return h->status;
}
int cr_march_inputs(void *state, int64_t steps, const cr_inputs *inputs) {
    cr_head *h = head(state);
    return h ? cr_core_march_inputs(h, work_of(state), waves_of(state), steps, inputs) : CR_BAD_MEMORY;
}

int cr_core_march(cr_head *h, double *work, double *waves, int64_t steps, const cr_boundary *boundary) {
    cr_inputs inputs[CHUNK];
    for (int n = 0; n < CHUNK; n++) {
        inputs[n].rail = boundary->rail_pressure;
        inputs[n].cylinder = boundary->cylinder_pressure;
        inputs[n].low = boundary->return_pressure;
        inputs[n].trace = boundary->drive;
    }
    while (steps > 0 && !h->status) {
        int64_t count = CHUNK - h->steps % CHUNK;
        if (count > steps) count = steps;
        cr_core_clocks(h, count, &inputs->since_start, &inputs->since_end, sizeof *inputs / sizeof(double));
        advance(h, work, waves, count, inputs);
        steps -= count;
    }
    return h->status;
}
int cr_march(void *state, int64_t steps, const cr_boundary *boundary) {
    cr_head *h = head(state);
    int status = cr_core_boundary(boundary);
    if (!h) return CR_BAD_MEMORY;
    return status ? status : cr_core_march(h, work_of(state), waves_of(state), steps, boundary);
}

double cr_time(const void *state) { return now_of(state); }
int64_t cr_steps(const void *state) { return ((const cr_head *)state)->steps; }

int cr_core_status(const cr_head *h, const double *work) {
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    if (h->status) return h->status;
    cr_kernel_figures(result, result + 1, work, h->cylinder, figures);
    int failed = failure(h, figures);
    return failed ? failed : figures[CR_F_CLOSED_AT_END] == 0.0 ? CR_STILL_INJECTING : CR_OK;
}
int cr_status(const void *state) {
    const cr_head *h = state;
    return h && h->stamp == CR_STAMP ? cr_core_status(h, work_in(state)) : CR_BAD_MEMORY;
}

void cr_core_observe(const cr_head *h, const double *work, double *channels) {
    void *result[2];
    cr_kernel_observe(result, result + 1, work, channels);
#ifdef CR_IDEAL_RAIL
    channels[CR_IDEAL_RAIL] = h->rail;
#else
    (void)h;
#endif
}
void cr_observe(const void *state, double channels[CR_CHANNELS]) { cr_core_observe(state, work_in(state), channels); }

void cr_core_figures(const cr_head *h, const double *work, cr_figures *out) {
    double figures[CR_KERNEL_FIGURES];
    void *result[2];
    cr_kernel_figures(result, result + 1, work, h->cylinder, figures);
    out->injected = figures[CR_F_INJECTED];
    out->returned = figures[CR_F_RETURNED];
    out->supplied = figures[CR_F_SUPPLIED];
    out->opening = h->start + h->dt * figures[CR_F_OPENING];
    out->closing = h->start + h->dt * figures[CR_F_CLOSING];
    out->first_closing = h->start + h->dt * figures[CR_F_FIRST_CLOSING];
    out->greatest_lift = figures[CR_F_GREATEST_LIFT];
    out->reference_density = h->density;
}
void cr_read_figures(const void *state, cr_figures *out) { cr_core_figures(state, work_in(state), out); }

const char *cr_sentence(int status) {
    for (int i = 0; i < CR_SENTENCES; i++)
        if (cr_sentences[i].status == status) return cr_sentences[i].text;
    return "There is no such status.";
}
