/* Kalman filter from shot to shot around blocks of the simulated injector: commonrail's plugins/observer in C. */
#include "cr_observer.h"
#include "cr_block.h"
#include "cr_core.h"
#include "cr_observer_model.h"
#include <math.h>
#include <string.h>

enum { N = CR_STATES, E = CR_O_EXTRA, ALL = N + E, COLUMNS = N + 1, PLACES = CR_O_BLOCKS * CR_LANES };
enum { Q = CR_O_QUIET, M = CR_O_SAMPLES - CR_O_QUIET, LOWER = CR_O_LANES - 1 };

typedef struct { /* plain data; the blocks of injectors follow it */
    uint64_t stamp;
    int64_t block, ring_slots, count; /* bytes of a block, samples so far */
    double work, spent, share; /* share: of the last sample in which the coil was energised */
    /* the shot that is being sampled, in samples */
    double ring[CR_O_RING], from[CR_MOST_INJECTIONS], until[CR_MOST_INJECTIONS];
    int32_t on, pulses, excess;
    /* the shot that is being evaluated */
    int32_t line, turn, warm, i, j, k, samples, steps, injections, ended, shots, vectors;
    double begun, rest, first; /* time of its first energising, pressure at rest, time of the first sample */
    cr_head clock;
    double measured[CR_O_SAMPLES], pressure[CR_O_SAMPLES], x[N], away[N];
    double trace[(CR_O_STEPS + 1) * PLACES], injected[PLACES][CR_O_STEPS + 1];
    int32_t bad[PLACES], cuts[CR_MOST_INJECTIONS + 1];
    double figures[PLACES][3][CR_MOST_INJECTIONS], slopes[3][CR_MOST_INJECTIONS][N];
    double white[CR_O_SAMPLES][COLUMNS], gram[COLUMNS][COLUMNS], squares;
    double base[CR_O_SAMPLES][CR_O_SAMPLES], factor[M][M], alike[CR_O_SAMPLES];
    /* the filter */
    double mean[N], before[N], covariance[N][N], prior[N][N], inverse[N][N], z[ALL], step[ALL], posterior[ALL][ALL], consistency;
    double shot_score[N], shot_information[N][N], kept[N][N]; /* of the test for a step */
    double left[CR_O_WINDOW][N][N], score[CR_O_WINDOW][N], information[CR_O_WINDOW][N];
    int32_t onsets;
    cr_observed out;
} Observer;

#define OBSERVER_BYTES ((sizeof(Observer) + 63) / 64 * 64)
static void *block_of(Observer *o, int b) { return (char *)o + OBSERVER_BYTES + (size_t)b * (size_t)o->block; }
static double sensor(const Observer *o, int state) { return state >= 0 ? o->x[state] : 0.0; } /* -1: there is none */
static double middle(const Observer *o, int j) { /* time of an averaged sample */
    double t = o->first + CR_SAMPLING * (j * CR_O_MANY + 0.5 * (CR_O_MANY - 1));
    return fabs(t) < 1e-6 * CR_O_MANY * CR_SAMPLING ? 0.0 : t; /* at the start but for rounding */
}
static double true_rest(const Observer *o) { /* in whole pascals: a rounding changes nothing that is simulated */
    return rint((o->rest - sensor(o, CR_O_OFFSET)) / (1.0 + sensor(o, CR_O_GAIN)));
}
static int state_of(int a) { return a < N ? a : cr_o_extra[a - N]; } /* of what a shot has for itself */

const char *cr_state_name(int index) { return index >= 0 && index < N ? cr_states[index].name : NULL; }
const char *cr_state_unit(int index) { return index >= 0 && index < N ? cr_states[index].unit : NULL; }

/* Small dense matrices. */

static double dot(const double *a, const double *b, int count) { /* four sums, which a processor adds side by side */
    double s[4] = {0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 4 <= count; i += 4)
        for (int j = 0; j < 4; j++) s[j] += a[i + j] * b[i + j];
    for (; i < count; i++) s[0] += a[i] * b[i];
    return (s[0] + s[1]) + (s[2] + s[3]);
}

/* Inverse of a symmetric positive definite matrix, by its Cholesky factor; 0 where it is not definite. */
static int invert(const double *a, double *inverse, int n) {
    double l[ALL * ALL], w[ALL * ALL];
    memset(w, 0, sizeof w);
    for (int r = 0; r < n; r++)
        for (int c = 0; c <= r; c++) {
            double rest = a[r * n + c] - dot(l + r * n, l + c * n, c);
            if (r == c && !(rest > 0.0)) return 0;
            l[r * n + c] = r == c ? sqrt(rest) : rest / l[c * n + c];
        }
    for (int c = 0; c < n; c++) /* w: columns of the factor's inverse as rows */
        for (int r = c; r < n; r++) w[c * n + r] = ((r == c) - dot(l + r * n + c, w + c * n + c, r - c)) / l[r * n + r];
    for (int r = 0; r < n; r++)
        for (int c = 0; c <= r; c++) inverse[r * n + c] = inverse[c * n + r] = dot(w + r * n + r, w + c * n + r, n - r);
    return 1;
}

/* Covariance of the disturbance between two averaged samples: plugins/observer/disturbance.py. */
static double disturbed(double s, double t) {
    const double m = CR_O_DISTURBANCE_MEMORY, apart = fabs(s - t);
    double pumped = 2.0 * m * fmin(s, t) + m * m * (exp(-s / m) + exp(-t / m) - 1.0 - exp(-apart / m));
    double wave = exp(-apart / CR_O_DISTURBANCE_DECAY) * cos(CR_O_TURN * CR_O_DISTURBANCE_FREQUENCY * apart);
    return CR_O_MEAN * CR_O_MEAN + CR_O_TREND * CR_O_TREND * s * t +
           CR_O_DISTURBANCE_RATE * CR_O_DISTURBANCE_RATE * pumped +
           CR_O_DISTURBANCE_WAVE * CR_O_DISTURBANCE_WAVE * wave +
           (s == t ? CR_O_DISTURBANCE_NOISE * CR_O_DISTURBANCE_NOISE + CR_O_FLOOR * CR_O_FLOOR : 0.0);
}

/* Factor of the covariance over the quiet samples, and what they leave of that of the others: the same for all shots. */
static void prepare(Observer *o) {
    const double spacing = CR_O_MANY * CR_SAMPLING;
    for (int r = 0; r < CR_O_SAMPLES; r++) {
        o->alike[r] = exp(-spacing * r / CR_O_DISCREPANCY_MEMORY);
        for (int c = 0; c <= r; c++) {
            double rest = disturbed(spacing * r, spacing * c) - dot(o->base[r], o->base[c], c < Q ? c : Q);
            o->base[r][c] = c >= Q ? rest : r == c ? sqrt(rest) : rest / o->base[c][c];
        }
    }
}

#define ROOMY_STEP fmax(0.9 * CR_O_STEP, CR_SHORTEST_STEP) /* room for waves that travel a tenth further */
static size_t block_bytes(void) {
    double parameters[CR_LANES][CR_PARAMETERS];
    for (int i = 0; i < CR_LANES; i++) cr_defaults(parameters[i]);
    return (cr_block_size(parameters[0], CR_LANES, ROOMY_STEP) + 63) / 64 * 64;
}
size_t cr_observer_size(void) { return OBSERVER_BYTES + CR_O_BLOCKS * block_bytes(); }

int cr_observer_begin(void *memory, size_t size, double work) {
    Observer *o = memory;
    cr_boundary at_rest = {CR_O_USUAL, CR_O_CYLINDER, CR_O_RETURN, 0.0};
    double parameters[CR_PARAMETERS];
    if (!o || (uintptr_t)memory % sizeof(double) || size < cr_observer_size()) return CR_BAD_MEMORY;
    if (!(work >= 0.0) || !isfinite(work)) return CR_OUTSIDE_DOMAIN;
    cr_defaults(parameters);
    int status = cr_check(parameters, &at_rest, CR_O_STEP, NULL);
    if (status) return status;
    memset(memory, 0, size);
    o->stamp = CR_STAMP;
    o->block = (int64_t)block_bytes();
    o->work = work > 0.0 ? work : CR_WORK_OF_STEP;
    o->ring_slots = cr_core_ring(parameters, ROOMY_STEP);
    o->vectors = cr_vectors();
    for (int i = 0; i < N; i++) {
        o->covariance[i][i] = cr_states[i].deviation * cr_states[i].deviation;
        o->out.drift_deviation[i] = cr_states[i].deviation;
    }
    prepare(o);
    return CR_OK;
}

/* Put to rest what a lane simulates: states x, a small change of one of them, or a lower pressure at rest. */
static int begin_lane(Observer *o, int lane) {
    double parameters[CR_PARAMETERS], at_rest = true_rest(o);
    cr_boundary own = {lane >= LOWER ? at_rest - CR_O_LOWER : at_rest, CR_O_CYLINDER, CR_O_RETURN, 0.0};
    void *block = block_of(o, lane / CR_LANES);
    int first = lane / CR_LANES * CR_LANES, count = CR_O_LANES - first < CR_LANES ? CR_O_LANES - first : CR_LANES;
    /* few injectors take less time one after another */
    if (lane == first) cr_block_open(block, o->ring_slots, count, count > 2 ? o->vectors : 1, CR_O_STEP);
    for (int changed = 1; changed >= 0; changed--) { /* a change that lies outside is none, and tells nothing */
        cr_defaults(parameters);
        for (int s = 0, place = 1; s < N; s++) {
            const cr_drift *d = cr_states + s;
            if (d->parameter < 0) continue;
            double x = o->x[s] + (place++ == lane && changed ? d->change : 0.0);
            parameters[d->parameter] = d->power != 0.0 ? d->value * exp(d->power * x) : d->value + x;
        }
        o->bad[lane] = !changed;
        if (cr_check(parameters, &own, CR_O_STEP, NULL) != CR_OK || cr_core_ring(parameters, CR_O_STEP) > o->ring_slots)
            continue;
        cr_block_put(block, lane % CR_LANES, parameters, &own);
        return 1;
    }
    return 0;
}

static void record(Observer *o, int k) {
    for (int b = 0; b < CR_O_BLOCKS; b++)
        for (int i = 0; i < CR_LANES && b * CR_LANES + i < CR_O_LANES; i++) {
            int stride, lane = b * CR_LANES + i;
            const double *rows = cr_block_rows(block_of(o, b), i, &stride);
            o->trace[k * PLACES + lane] = rows[CR_O_ROW_PRESSURE * stride];
            o->injected[lane][k] = rows[CR_O_ROW_INJECTED * stride];
        }
}

static void march(Observer *o) { /* one time step of all injectors */
    cr_inputs inputs[CR_LANES] = {{o->rest, CR_O_CYLINDER, CR_O_RETURN, 0.0, 0.0, 0.0}};
    cr_core_clocks(&o->clock, 1, &inputs[0].since_start, &inputs[0].since_end, 1);
    for (int i = 1; i < CR_LANES; i++) inputs[i] = inputs[0];
    for (int b = 0; b < CR_O_BLOCKS; b++) cr_block_march_inputs(block_of(o, b), 1, inputs);
    record(o, (int)++o->clock.steps);
}

/* Instant at which the rate, that of step i in its middle, meets a level before the middle of the next step. */
static double crossing(const double *injected, int steps, double level, int i) {
    if (i < 0 || i >= steps - 1) return NAN;
    double rate = injected[i + 1] - injected[i], next = injected[i + 2] - injected[i + 1];
    return CR_O_STEP * i + (0.5 + (level - rate) / (next - rate)) * CR_O_STEP;
}

/* Steps between which the injections lie: where the rate is least as the next one begins. */
static void cut(Observer *o) {
    const double *injected = o->injected[0];
    for (int p = 1; p < o->injections; p++) {
        double start = o->clock.from[p], end = start + fmin(CR_O_LATEST, o->clock.until[p] - start);
        int k = (int)(start / CR_O_STEP), least;
        while (CR_O_STEP * k < start) k++;
        for (least = k++; k < o->steps && CR_O_STEP * k < end; k++)
            if (injected[k + 1] - injected[k] < injected[least + 1] - injected[least]) least = k;
        o->cuts[p] = least;
    }
    o->cuts[0] = 0;
    o->cuts[o->injections] = o->steps;
}

/* Quantity, opening and closing of each injection of a lane. */
static void read_figures(Observer *o, int lane) {
    const double *injected = o->injected[lane];
    for (int p = 0; p < o->injections; p++) {
        int first = o->cuts[p], last = o->cuts[p + 1], body[2] = {-1, -1};
        double most = 0.0, *figures = &o->figures[lane][0][p];
        figures[0] = (injected[last] - injected[first]) / cr_o_density[o->warm][lane == CR_O_WARMER];
        figures[CR_MOST_INJECTIONS] = figures[2 * CR_MOST_INJECTIONS] = NAN;
        for (int k = first; k < last; k++)
            if (injected[k + 1] - injected[k] > most) most = injected[k + 1] - injected[k];
        if (!(most > 0.0)) continue;
        double level = CR_O_OPEN * most, full = CR_O_BODY / CR_O_OPEN * level;
        for (int k = first; k < last; k++)
            if (injected[k + 1] - injected[k] > full) body[1] = k, body[0] = body[0] < 0 ? k : body[0];
        int k = body[0] - 1;
        while (k >= 0 && injected[k + 1] - injected[k] > level) k--;
        figures[CR_MOST_INJECTIONS] = crossing(injected, o->steps, level, k);
        for (k = body[1] + 1; k < o->steps && injected[k + 1] - injected[k] > level;) k++;
        if (k < o->steps) figures[2 * CR_MOST_INJECTIONS] = crossing(injected, o->steps, level, k - 1);
    }
}

/* Mean of the simulated pressures of all lanes over an averaged sample, which the sensor shows later by a delay. */
static void sampled(const Observer *o, int j, double delay, double *mean) {
    memset(mean, 0, PLACES * sizeof *mean);
    for (int m = 0; m < CR_O_MANY; m++) {
        double u = (o->first + CR_SAMPLING * (j * CR_O_MANY + m) - delay) / CR_O_STEP;
        int k = u <= 0.0 ? 0 : u >= o->steps ? o->steps - 1 : (int)u;
        double part = u <= 0.0 ? 0.0 : u >= o->steps ? 1.0 : u - k;
        const double *a = o->trace + k * PLACES, *b = a + PLACES;
        for (int lane = 0; lane < PLACES; lane++) mean[lane] += a[lane] + part * (b[lane] - a[lane]);
    }
    for (int lane = 0; lane < PLACES; lane++) mean[lane] = mean[lane] / CR_O_MANY - o->trace[lane];
}

/* Model's pressure of an averaged sample, its slopes by the states, and what is left of the measured one. */
static int respond(Observer *o, int j) {
    double shown[PLACES], late[PLACES], scale = 1.0 + sensor(o, CR_O_GAIN), *w = o->white[j];
    int lane = 1;
    sampled(o, j, sensor(o, CR_O_DELAY), shown);
    sampled(o, j, sensor(o, CR_O_DELAY) + CR_O_LATER, late);
    for (int i = 0; i < PLACES; i++) shown[i] *= scale;
    double by_rest = (shown[LOWER] - shown[0]) / CR_O_LOWER;
    for (int s = 0; s < N; s++) {
        w[s] = 0.0;
        if (cr_states[s].parameter >= 0) {
            if (!o->bad[lane]) w[s] = (shown[lane] - shown[0]) / cr_states[s].change;
            lane++;
        } else if (s == CR_O_DELAY) {
            w[s] = (scale * late[0] - shown[0]) / CR_O_LATER;
        } else if (!o->bad[LOWER]) {
            if (s == CR_O_OFFSET) w[s] = by_rest / scale;
            if (s == CR_O_GAIN) w[s] = (shown[0] + true_rest(o) * by_rest) / scale;
        }
    }
    o->pressure[j] = shown[0] + dot(w, o->away, N);
    w[N] = o->measured[j] - o->pressure[j];
    for (int a = 0; a < ALL; a++) w[N] += w[state_of(a)] * (o->z[a] - (a < N ? o->mean[a] : 0.0));
    return isfinite(o->pressure[j]);
}

/* Slopes of the figures by the states. */
static void differentiate(Observer *o) {
    double scale = 1.0 + sensor(o, CR_O_GAIN);
    for (int f = 0; f < 3; f++)
        for (int p = 0; p < o->injections; p++) {
            double here = o->figures[0][f][p], *slopes = o->slopes[f][p];
            int lane = 1;
            for (int s = 0; s < N; s++) {
                double slope = 0.0;
                if (cr_states[s].parameter >= 0) {
                    if (!o->bad[lane]) slope = (o->figures[lane][f][p] - here) / cr_states[s].change;
                    lane++;
                } else if (!o->bad[LOWER] && s != CR_O_DELAY) {
                    slope = (o->figures[LOWER][f][p] - here) / CR_O_LOWER / scale;
                    if (s == CR_O_GAIN) slope *= true_rest(o);
                }
                slopes[s] = isfinite(slope) ? slope : 0.0;
            }
        }
}

/* States to be simulated: the nearest ones of a grid, from which the response is linear; 0 where they are those before. */
static int place_states(Observer *o) {
    double before[N];
    memcpy(before, o->x, sizeof before);
    for (int s = 0; s < N; s++) {
        double x = o->z[s], cell = CR_O_GRID * cr_states[s].deviation;
        for (int e = 0; e < E; e++) x += cr_o_extra[e] == s ? o->z[N + e] : 0.0;
        o->x[s] = rint(x / cell) * cell;
        if (s == CR_O_TEMPERATURE) {
            o->warm = 0;
            for (int i = 1; i < (int)(sizeof cr_o_warmth / sizeof *cr_o_warmth); i++)
                if (fabs(cr_o_warmth[i] - x) < fabs(cr_o_warmth[o->warm] - x)) o->warm = i;
            o->x[s] = cr_o_warmth[o->warm];
        }
        o->away[s] = x - o->x[s];
    }
    return o->turn == 0 || memcmp(before, o->x, sizeof before) != 0;
}

/* Posterior and Gauss-Newton step of plugins/observer/kalman.py; 1 where the iteration ends. */
static int correct(Observer *o) {
    double a[ALL][ALL], gain[ALL], largest = 0.0;
    for (int r = 0; r < ALL; r++) {
        gain[r] = o->gram[N][state_of(r)];
        for (int c = 0; c < ALL; c++) {
            a[r][c] = state_of(r) > state_of(c) ? o->gram[state_of(r)][state_of(c)] : o->gram[state_of(c)][state_of(r)];
            if (r < N && c < N) a[r][c] += o->inverse[r][c];
            if (r >= N && r == c) a[r][c] += 1.0 / (cr_states[state_of(r)].scatter * cr_states[state_of(r)].scatter);
        }
    }
    if (!invert(a[0], o->posterior[0], ALL)) return -1;
    for (int r = 0; r < ALL; r++) o->step[r] = (r < N ? o->mean[r] : 0.0) + dot(o->posterior[r], gain, ALL) - o->z[r];
    if (o->turn == 0) {
        double explained = 0.0;
        for (int r = 0; r < ALL; r++) explained += gain[r] * dot(o->posterior[r], gain, ALL);
        o->consistency = (o->gram[N][N] - explained) / o->samples;
        if (!(o->consistency <= CR_TRUSTED)) { /* nothing is learnt, nor where it overflows */
            memset(o->posterior, 0, sizeof o->posterior);
            memset(o->step, 0, sizeof o->step);
            for (int r = 0; r < N; r++) memcpy(o->posterior[r], o->prior[r], sizeof o->prior[r]);
            for (int e = 0; e < E; e++)
                o->posterior[N + e][N + e] = cr_states[cr_o_extra[e]].scatter * cr_states[cr_o_extra[e]].scatter;
            return 1;
        }
    }
    for (int r = 0; r < ALL; r++) {
        double spread = r < N ? sqrt(o->prior[r][r]) : cr_states[state_of(r)].scatter;
        o->step[r] = fmin(fmax(o->step[r], -3.0 * spread), 3.0 * spread);
        o->z[r] += o->step[r];
        largest = fmax(largest, fabs(o->step[r]) / spread);
    }
    return largest < CR_O_CONVERGED;
}

/* Which shot the outputs are of, and whether it has figures. */
static void name_shot(Observer *o, int valid) {
    o->out.valid = valid;
    o->out.start = o->begun;
    o->out.rail_pressure = o->rest;
    o->out.injections = o->injections;
    o->out.consistency = valid ? o->consistency : NAN;
    o->out.alarm = o->out.alarm_ago = o->out.alarm_size = o->out.alarm_deviation = 0.0;
}

/* Figures of the shot into the output, and the states learnt. */
static void conclude(Observer *o) {
    for (int p = 0; p < CR_MOST_INJECTIONS; p++) {
        int opens = p < o->injections && isfinite(o->figures[0][1][p]); /* else its slopes tell nothing */
        for (int f = 0; f < 3; f++) {
            double variance = f ? CR_O_TIMES * CR_O_TIMES : 0.0, value = NAN, by[ALL];
            if (p < o->injections) {
                for (int a = 0; a < ALL; a++) by[a] = o->slopes[f][p][state_of(a)];
                value = o->figures[0][f][p] + dot(o->slopes[f][p], o->away, N) + dot(by, o->step, ALL);
                for (int a = 0; a < ALL; a++) variance += by[a] * dot(o->posterior[a], by, ALL);
            }
            (&o->out.injection[p].quantity)[f] = value;
            (&o->out.injection[p].quantity)[f + 3] = opens && isfinite(value) ? sqrt(variance) : NAN;
        }
    }
    for (int s = 0; s < N; s++) {
        o->before[s] = o->mean[s];
        o->mean[s] = o->z[s];
        memcpy(o->covariance[s], o->posterior[s], sizeof o->covariance[s]);
        o->out.drift[s] = o->mean[s];
        o->out.drift_deviation[s] = sqrt(o->covariance[s][s]);
    }
    name_shot(o, 1);
}

/* Sums of the test for a step at one of the last shots: `StepTest` of plugins/observer/kalman.py. */
static void open_onset(Observer *o) {
    if (o->onsets == CR_O_WINDOW) {
        memmove(o->left[0], o->left[1], (CR_O_WINDOW - 1) * sizeof o->left[0]);
        memmove(o->score[0], o->score[1], (CR_O_WINDOW - 1) * sizeof o->score[0]);
        memmove(o->information[0], o->information[1], (CR_O_WINDOW - 1) * sizeof o->information[0]);
        o->onsets--;
    }
    memset(o->left[o->onsets], 0, sizeof o->left[0]);
    memset(o->score[o->onsets], 0, sizeof o->score[0]);
    memset(o->information[o->onsets], 0, sizeof o->information[0]);
    for (int s = 0; s < N; s++) o->left[o->onsets][s][s] = 1.0;
    o->onsets++;
}

/* What a shot adds to the test: score, information, and how much of an error of the mean it leaves. */
static void compare(Observer *o) {
    double moved[N];
    for (int s = 0; s < N; s++) moved[s] = o->mean[s] - o->before[s];
    for (int r = 0; r < N; r++) {
        o->shot_score[r] = dot(o->inverse[r], moved, N);
        for (int c = 0; c < N; c++) o->kept[r][c] = dot(o->covariance[r], o->inverse[c], N);
    }
    for (int r = 0; r < N; r++)
        for (int c = 0; c < N; c++) {
            o->shot_information[r][c] = o->inverse[r][c];
            for (int k = 0; k < N; k++) o->shot_information[r][c] -= o->inverse[r][k] * o->kept[k][c];
        }
}

static void test_onset(Observer *o, int i) {
    double next[N][N], column[N];
    for (int c = 0; c < N; c++) {
        for (int r = 0; r < N; r++) column[r] = o->left[i][r][c];
        o->score[i][c] += dot(column, o->shot_score, N);
        for (int r = 0; r < N; r++) {
            o->information[i][c] += column[r] * dot(o->shot_information[r], column, N);
            next[r][c] = dot(o->kept[r], column, N);
        }
    }
    memcpy(o->left[i], next, sizeof next);
}

/* Most significant step; what has changed is learnt again. */
static void raise_alarm(Observer *o) {
    double largest = CR_O_SIGNIFICANCE;
    for (int i = 0; i < o->onsets; i++)
        for (int s = 0; s < N; s++) {
            double deviation = 1.0 / sqrt(fmax(o->information[i][s], 1e-300)), size = o->score[i][s] * deviation * deviation;
            if (cr_states[s].limit == 0.0 || !(fabs(size) > cr_states[s].limit) || !(fabs(size) / deviation > largest))
                continue;
            largest = fabs(size) / deviation;
            o->out.alarm = s + 1;
            o->out.alarm_ago = o->onsets - 1 - i;
            o->out.alarm_size = size;
            o->out.alarm_deviation = deviation;
        }
    if (o->out.alarm == 0.0) return;
    int s = (int)o->out.alarm - 1;
    o->covariance[s][s] += cr_states[s].deviation * cr_states[s].deviation;
    o->onsets = 0;
    o->out.alarms += 1.0;
}

static const double *factor_of(const Observer *o, int r, int c) {
    return c < Q ? &o->base[r][c] : &o->factor[r - Q][c - Q];
}

/* A slice of the work on a shot. `line` keeps where the next one goes on, as loops' counters are kept in the observer. */
#define AT_LINE(cost, place) \
    do { \
        o->spent += (cost); \
        if (o->spent >= o->work) { \
            o->line = place; \
            return; \
        case place:; \
        } \
    } while (0)
#define PAUSE(cost) AT_LINE(cost, __LINE__)
#define PRODUCTS(count) ((count) / 1000.0) /* products and sums, in time steps of a block */

static void evaluate(Observer *o) {
    switch (o->line) {
    case 1:
        for (int r = 0; r < N; r++) {
            memcpy(o->prior[r], o->covariance[r], sizeof o->prior[r]);
            o->prior[r][r] += cr_states[r].walk * cr_states[r].walk;
            o->z[r] = o->mean[r];
        }
        for (int e = 0; e < E; e++) o->z[N + e] = 0.0;
        if (!invert(o->prior[0], o->inverse[0], N)) goto failed;
        PAUSE(PRODUCTS(2 * N * N * N));
        for (o->turn = 0; o->turn < CR_O_ITERATIONS; o->turn++) {
            if (place_states(o)) {
                for (o->i = 0; o->i < PLACES; o->i++) {
                    if (!begin_lane(o, o->i)) goto failed;
                    PAUSE(CR_O_BEGIN);
                }
                o->clock.steps = 0;
                record(o, 0);
                while (o->clock.steps < o->steps) {
                    march(o);
                    PAUSE(CR_O_BLOCKS);
                }
                cut(o);
                for (o->i = 0; o->i < CR_O_LANES; o->i++) {
                    int status = cr_block_status(block_of(o, o->i / CR_LANES), o->i % CR_LANES);
                    o->bad[o->i] |= status != CR_OK && status != CR_STILL_INJECTING;
                    if (o->bad[0]) goto failed;
                    read_figures(o, o->i);
                    PAUSE(PRODUCTS(5 * o->steps));
                }
                differentiate(o);
            }
            for (o->j = 0; o->j < o->samples; o->j++) {
                if (!respond(o, o->j)) goto failed;
                PAUSE(PRODUCTS(30 * CR_O_MANY * PLACES));
            }
            for (o->j = 0; o->j < o->samples - Q; o->j++) /* factor of what the quiet samples leave */
                for (o->k = 0; o->k <= o->j; o->k++) {
                    int r = Q + o->j, c = Q + o->k;
                    double *row = o->factor[o->j], rest = o->base[r][c] - dot(row, o->factor[o->k], o->k);
                    if (middle(o, r) > 0.0 && middle(o, c) > 0.0)
                        rest += CR_O_DISCREPANCY * CR_O_DISCREPANCY * o->alike[r - c] * fabs(o->pressure[r] * o->pressure[c]);
                    row[o->k] = o->k == o->j ? sqrt(rest) : rest / o->factor[o->k][o->k];
                    PAUSE(PRODUCTS(10 + o->k));
                }
            memset(o->gram, 0, sizeof o->gram);
            for (o->j = 0; o->j < o->samples; o->j++) { /* white samples, and their products */
                double *w = o->white[o->j];
                for (int k = 0; k < o->j; k++)
                    for (int c = 0; c < COLUMNS; c++) w[c] -= *factor_of(o, o->j, k) * o->white[k][c];
                for (int c = 0; c < COLUMNS; c++) w[c] /= *factor_of(o, o->j, o->j);
                for (int r = 0; r < COLUMNS; r++)
                    for (int c = 0; c <= r; c++) o->gram[r][c] += w[r] * w[c];
                PAUSE(PRODUCTS(COLUMNS * (o->j + COLUMNS)));
            }
            o->ended = correct(o);
            if (o->ended < 0) goto failed;
            PAUSE(PRODUCTS(2 * ALL * ALL * ALL));
            if (o->ended) break;
        }
        conclude(o);
        PAUSE(PRODUCTS(6 * o->injections * ALL * ALL));
        if (o->shots >= CR_O_LEARNING && o->consistency <= CR_TRUSTED) {
            open_onset(o);
            compare(o);
            PAUSE(PRODUCTS(3 * N * N * N));
            for (o->i = 0; o->i < o->onsets; o->i++) {
                test_onset(o, o->i);
                PAUSE(PRODUCTS(2 * N * N * N));
            }
            raise_alarm(o);
        }
        break;
    failed:
        o->out.failed += 1.0;
        name_shot(o, 0);
        for (int p = 0; p < CR_MOST_INJECTIONS; p++)
            for (int f = 0; f < 6; f++) (&o->out.injection[p].quantity)[f] = NAN;
    }
    o->out.shots += 1.0;
    o->shots++;
    o->line = 0;
}

/* The shot that was sampled is complete: its averaged samples are kept, and the ring is free for the next one. */
static void close_shot(Observer *o) {
    const double tiny = 1e-6, begin = o->from[0];
    double end = o->until[o->pulses - 1], before = begin - CR_O_BEFORE / CR_SAMPLING;
    int64_t first = (int64_t)ceil(before - tiny), last = (int64_t)ceil(end + CR_O_AFTER / CR_SAMPLING - tiny);
    int resting = 0;
    cr_energising plan[CR_MOST_INJECTIONS];
    int pulses = o->pulses, fits = !o->excess && (last - first) / CR_O_MANY <= CR_O_SAMPLES && o->count - first <= CR_O_RING;
    o->pulses = o->excess = 0;
    if (before < -0.5) return; /* not whole */
    if (first < 0) first = 0;
    if (o->line || !fits) {
        o->out.missed += 1.0;
        o->shots++;
        return;
    }
    o->samples = (int)((last - first) / CR_O_MANY);
    o->first = CR_SAMPLING * ((double)first - begin);
    o->begun = CR_SAMPLING * begin;
    o->rest = 0.0;
    for (int j = 0; j < o->samples; j++) {
        o->measured[j] = 0.0;
        for (int m = 0; m < CR_O_MANY; m++) o->measured[j] += o->ring[(first + j * CR_O_MANY + m) % CR_O_RING];
        o->measured[j] /= CR_O_MANY;
        if (middle(o, j) < 0.0) o->rest += o->measured[j], resting++;
    }
    o->rest /= resting;
    for (int j = 0; j < o->samples; j++) o->measured[j] -= o->rest;
    o->steps = (int)ceil((o->first + CR_SAMPLING * (double)(last - 1 - first) + 20e-6) / CR_O_STEP);
    o->injections = pulses;
    for (int p = 0; p < pulses; p++) {
        plan[p].start = rint(1e9 * CR_SAMPLING * (o->from[p] - begin)) / 1e9;
        plan[p].duration = rint(1e9 * CR_SAMPLING * (o->until[p] - o->from[p])) / 1e9;
    }
    memset(&o->clock, 0, sizeof o->clock);
    o->clock.dt = CR_O_STEP;
    cr_core_plan(&o->clock, plan, pulses);
    o->line = 1;
}

int cr_observer_step(void *memory, double pressure, double command) {
    Observer *o = memory;
    int good = fabs(pressure) < 1e10 && isfinite(command); /* no sensor shows 10 GPa: such squares overflow */
    if (!o || o->stamp != CR_STAMP) return CR_BAD_MEMORY;
    if (o->line) {
        o->spent = 0.0;
        evaluate(o);
        if (o->spent > o->out.longest) o->out.longest = o->spent;
    }
    double now = (double)o->count, share = good ? fmin(fmax(command, 0.0), 1.0) : o->on;
    share = share < 1e-6 ? 0.0 : share > 1.0 - 1e-6 ? 1.0 : share; /* but for rounding */
    double before = o->share;
    o->share = share;
    o->ring[o->count % CR_O_RING] = good ? pressure : o->ring[(o->count + CR_O_RING - 1) % CR_O_RING];
    o->count++;
    if (share > 0.0 && !o->on) {
        double start = now - share;
        if (o->pulses && before > 0.0) { /* an edge over some samples, as interpolation makes it: its middle counts */
            double *from = o->from + o->pulses - 1, *until = o->until + o->pulses - 1;
            if (share < 1.0) *until += share;
            else *from = start - (*until - *from), *until = now, o->on = 1;
            return good ? CR_OK : CR_BAD_BOUNDARY;
        }
        if (o->pulses && start - o->until[o->pulses - 1] >= CR_PAUSE / CR_SAMPLING) close_shot(o);
        if (o->pulses == CR_MOST_INJECTIONS) o->excess = 1, o->pulses--;
        o->from[o->pulses++] = start;
        o->until[o->pulses - 1] = now;
        o->on = 1;
    } else if (o->on) {
        o->until[o->pulses - 1] = now - 1.0 + share;
        o->on = share == 1.0;
    }
    if (o->pulses && !o->on && now - o->until[o->pulses - 1] >= CR_PAUSE / CR_SAMPLING) close_shot(o);
    return good ? CR_OK : CR_BAD_BOUNDARY;
}

void cr_observer_read(const void *memory, cr_observed *observed) {
    if (memory && observed) *observed = ((const Observer *)memory)->out;
}
