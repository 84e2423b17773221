/* Instance of the FMU: variables by reference, communication steps, states. */
#include "cr_fmu.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct { /* a kept state; the numbers of the simulation, if it has begun, follow it */
    uint64_t size; /* of both */
    Kept kept;
} Snapshot;

Instance *fmu_new(const char *name) {
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    if (!name) name = "";
    m->name = malloc(strlen(name) + 1);
    if (!m->name) {
        free(m);
        return NULL;
    }
    strcpy(m->name, name);
    fmu_preset(m);
    return m;
}

void fmu_free(Instance *m) {
    if (!m) return;
    free(m->state);
    free(m->name);
    free(m);
}

void fmu_preset(Instance *m) {
    memset(&m->kept, 0, sizeof m->kept);
    cr_defaults(m->kept.parameters);
    m->kept.step = CR_FMU_STEP;
    m->kept.input.rail_pressure = CR_FMU_RAIL;
    m->kept.input.cylinder_pressure = CR_FMU_CYLINDER;
    m->kept.input.return_pressure = CR_FMU_RETURN;
    m->kept.dirty = 1;
    m->observed = 0;
}

/* 1 if the model reads an input while it is simulated. */
static int reads(unsigned reference) {
    static const int read[] = {CR_FMU_READS_RAIL_PRESSURE, 1, CR_FMU_READS_RETURN_PRESSURE, CR_FMU_READS_DRIVE};
    return read[reference - VR_INPUT];
}

double *fmu_writable(Instance *m, unsigned reference) {
    Kept *k = &m->kept;
    double *inputs = &k->input.rail_pressure, *to = NULL;
    int fixed = 1;
    if (reference < CR_PARAMETERS) to = k->parameters + reference;
    else if (reference == VR_STEP) to = &k->step;
    else if (reference >= VR_PLAN && reference < VR_PLAN + 2 * PLANNED) to = k->plan + (reference - VR_PLAN);
    else if (reference >= VR_INPUT && reference < VR_INPUT + 4 && (reads(reference) || reference == VR_INPUT))
        to = inputs + (reference - VR_INPUT), fixed = !reads(reference); /* a rail's volume: its pressure at rest */
    if (to && fixed && k->phase > INITIALISING) return NULL;
    if (to && k->phase <= INITIALISING) k->dirty = 1;
    return to;
}

static double instant(double value) { return isfinite(value) ? value : 0.0; }

int fmu_read(Instance *m, unsigned reference, double *value) {
    const Kept *k = &m->kept;
    const double *inputs = &k->input.rail_pressure;
    if (reference < CR_PARAMETERS) return *value = k->parameters[reference], 1;
    if (reference == VR_STEP) return *value = k->step, 1;
    if (reference >= VR_PLAN && reference < VR_PLAN + 2 * PLANNED) return *value = k->plan[reference - VR_PLAN], 1;
    if (reference >= VR_INPUT && reference < VR_INPUT + 4) return *value = inputs[reference - VR_INPUT], 1;
    if (reference < VR_CHANNEL || reference > VR_STATUS) return 0;
    if (k->dirty && k->phase == INITIALISING) fmu_begin(m);
    if (!m->observed && m->state && !k->dirty) {
        cr_observe(m->state, m->channels);
        cr_read_figures(m->state, &m->figures);
        m->observed = 1;
    }
    if (reference < VR_CHANNEL + CR_CHANNELS) return *value = m->channels[reference - VR_CHANNEL], 1;
    switch (reference) {
    case VR_RATE: *value = k->rate; return 1;
    case VR_RETURN_RATE: *value = k->return_rate; return 1;
    case VR_OPENING: *value = instant(m->figures.opening); return 1;
    case VR_CLOSING: *value = instant(m->figures.closing); return 1;
    case VR_FIRST_CLOSING: *value = instant(m->figures.first_closing); return 1;
    case VR_OPEN: *value = isfinite(m->figures.opening) && !isfinite(m->figures.closing); return 1;
    case VR_STATUS: *value = m->state && !k->dirty ? cr_status(m->state) : 0; return 1;
    default: return 0;
    }
}

static int sized(Instance *m, size_t size) {
    if (m->state && m->size == size) return 1;
    void *state = malloc(size);
    if (!state) return 0;
    free(m->state);
    m->state = state;
    m->size = size;
    return 1;
}

static int failed(Instance *m, int status) {
    m->sentence = status ? cr_sentence(status) : NULL;
    return status;
}

int fmu_begin(Instance *m) {
    Kept *k = &m->kept;
    cr_energising plan[PLANNED];
    int count = 0, status = cr_check(k->parameters, &k->input, k->step, NULL);
    if (status) return failed(m, status);
    size_t size = cr_state_size(k->parameters, k->step);
    if (!size || !sized(m, size)) return failed(m, CR_BAD_MEMORY);
    status = cr_begin(m->state, m->size, k->parameters, &k->input, k->step, k->begun);
    if (status) return failed(m, status);
    for (int i = 0; i < PLANNED; i++)
        if (k->plan[2 * i + 1] != 0.0)
            plan[count].start = k->begun + k->plan[2 * i], plan[count++].duration = k->plan[2 * i + 1];
    status = cr_plan(m->state, plan, count);
    k->time = k->begun;
    k->rate = k->return_rate = k->injected = k->returned = 0.0;
    k->commanded = 0;
    k->dirty = status != CR_OK;
    m->observed = 0;
    return failed(m, status);
}

int fmu_too_long(const Instance *m, double length) { return length > MOST_STEPS * m->kept.step; }

int fmu_step(Instance *m, double now, double length) {
    Kept *k = &m->kept;
    cr_figures figures;
    double end = now + length;
    int status = CR_OK;
    if (k->command != k->commanded) {
        status = cr_switch(m->state, now, k->command);
        if (status) return failed(m, status);
        k->commanded = k->command;
    }
    /* whole steps that fit: the time is counted in them, so that nothing drifts */
    int64_t before = cr_steps(m->state);
    int64_t steps = (int64_t)floor((end - k->begun) / k->step + 1e-6) - before;
    if (steps > 0) status = cr_march(m->state, steps, &k->input);
    m->observed = 0;
    if (status) return failed(m, status);
    if (steps > 0) {
        cr_read_figures(m->state, &figures);
        k->rate = (figures.injected - k->injected) / (k->step * (double)steps);
        k->return_rate = (figures.returned - k->returned) / (k->step * (double)steps);
        k->injected = figures.injected;
        k->returned = figures.returned;
    }
    k->time = end;
    return CR_OK;
}

int fmu_get_state(const Instance *m, void **kept) {
    size_t size = sizeof(Snapshot) + (m->state ? m->size : 0);
    Snapshot *s = *kept && fmu_state_size(*kept) == size ? *kept : realloc(*kept, size);
    if (!s) return 0;
    memset(s, 0, sizeof *s);
    s->size = size;
    s->kept = m->kept;
    if (m->state) memcpy(s + 1, m->state, m->size);
    *kept = s;
    return 1;
}

int fmu_set_state(Instance *m, const void *kept) {
    const Snapshot *s = kept;
    size_t held = (size_t)s->size - sizeof *s;
    if (s->size < sizeof *s || (held && !sized(m, held))) return 0;
    if (held) memcpy(m->state, s + 1, held);
    m->kept = s->kept;
    if (!held) m->kept.dirty = 1;
    m->observed = 0;
    m->sentence = NULL;
    return 1;
}

void fmu_free_state(void **kept) {
    if (!kept) return;
    free(*kept);
    *kept = NULL;
}

size_t fmu_state_size(const void *kept) { return (size_t)((const Snapshot *)kept)->size; }

int fmu_write_state(const void *kept, void *bytes, size_t size) {
    if (size < fmu_state_size(kept)) return 0;
    memcpy(bytes, kept, fmu_state_size(kept));
    return 1;
}

int fmu_read_state(void **kept, const void *bytes, size_t size) {
    Snapshot head;
    if (!bytes || size < sizeof head) return 0;
    memcpy(&head, bytes, sizeof head);
    if (head.size > size || head.size < sizeof head) return 0;
    void *to = realloc(*kept, size);
    if (!to) return 0;
    memcpy(to, bytes, size);
    *kept = to;
    return 1;
}
