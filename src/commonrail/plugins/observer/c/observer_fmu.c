/* Variables of the observer's FMU by reference, and its communication steps. */
#include "cr_fmu.h"
#include <math.h>
#include <string.h>

void fmu_preset(Instance *m) {
    memset(&m->kept, 0, sizeof m->kept);
    m->kept.pressure = CR_FMU_RAIL;
    m->kept.work = CR_WORK_OF_STEP;
    m->kept.dirty = 1;
    m->observed = 0;
}

double *fmu_writable(Instance *m, unsigned reference) {
    Kept *k = &m->kept;
    if (reference == VR_PRESSURE) return &k->pressure;
    if (reference == VR_SHARE) return &k->share;
    if (reference != VR_WORK || k->phase > INITIALISING) return NULL;
    k->dirty = 1;
    return &k->work;
}

int fmu_read(Instance *m, unsigned reference, double *value) {
    if (reference <= VR_WORK) return *value = (&m->kept.pressure)[reference], 1;
    if (reference < VR_OUT || reference >= VR_OUT + sizeof(cr_observed) / sizeof(double)) return 0;
    if (m->kept.dirty && m->kept.phase == INITIALISING) fmu_begin(m);
    if (!m->observed && m->state && !m->kept.dirty) {
        cr_observer_read(m->state, &m->seen.out);
        m->observed = 1;
    }
    *value = (&m->seen.out.shots)[reference - VR_OUT];
    if (!isfinite(*value)) *value = 0.0;
    return 1;
}

static int failed(Instance *m, int status) {
    m->sentence = status ? cr_sentence(status) : NULL;
    return status;
}

int fmu_begin(Instance *m) {
    Kept *k = &m->kept;
    if (!fmu_sized(m, cr_observer_size())) return failed(m, CR_BAD_MEMORY);
    k->dirty = cr_observer_begin(m->state, m->size, k->work);
    k->time = k->begun;
    k->samples = 0;
    k->energised = 0.0;
    m->observed = 0;
    return failed(m, k->dirty);
}

int fmu_too_long(const Instance *m, double length) { return (void)m, length > 1e7 * CR_SAMPLING; }

/* Samples fall on whole sampling intervals since the beginning; one at the end of a step belongs to the next. */
int fmu_step(Instance *m, double now, double length) {
    Kept *k = &m->kept;
    int status = CR_OK;
    k->time = now;
    for (;;) {
        double due = k->begun + CR_SAMPLING * (double)k->samples;
        if (due > now + length - 1e-6 * CR_SAMPLING) break;
        k->energised += k->share * fmax(due - k->time, 0.0);
        status |= cr_observer_step(m->state, k->pressure, k->energised / CR_SAMPLING);
        k->energised = 0.0;
        k->time = due;
        k->samples++;
    }
    k->energised += k->share * (now + length - k->time);
    k->time = now + length;
    m->observed = 0;
    return failed(m, status);
}
