/* Variables of the injector's FMU by reference, and its communication steps. */
#include "cr_fmu.h"
#include <math.h>
#include <string.h>

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
        cr_observe(m->state, m->seen.channels);
        cr_read_figures(m->state, &m->seen.figures);
        m->observed = 1;
    }
    if (reference < VR_CHANNEL + CR_CHANNELS) return *value = m->seen.channels[reference - VR_CHANNEL], 1;
    switch (reference) {
    case VR_RATE: *value = k->rate; return 1;
    case VR_RETURN_RATE: *value = k->return_rate; return 1;
    case VR_OPENING: *value = instant(m->seen.figures.opening); return 1;
    case VR_CLOSING: *value = instant(m->seen.figures.closing); return 1;
    case VR_FIRST_CLOSING: *value = instant(m->seen.figures.first_closing); return 1;
    case VR_OPEN: *value = isfinite(m->seen.figures.opening) && !isfinite(m->seen.figures.closing); return 1;
    case VR_STATUS: *value = m->state && !k->dirty ? cr_status(m->state) : 0; return 1;
    default: return 0;
    }
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
    if (!size || !fmu_sized(m, size)) return failed(m, CR_BAD_MEMORY);
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
