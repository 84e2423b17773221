/* A foreign FMU for tests, written by hand to FMI 2.0: two equations with known solutions, and failures on demand.

   Dahlquist's equation x' = -k x + u, solved exactly over each communication step with u held, and van der Pol's
   x0' = x1, x1' = mu (1 - x0^2) x1 - x0 by the classical Runge-Kutta method. A share of all values of k fails. */
#include "fmi2Functions.h"
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

enum { K, X0, U, X, MU, VDP, SHARE, VALUES };
enum { NONE, DISCARD, FAIL, FATAL, NO_NUMBER, CRASH, HANG, REFUSE };

typedef struct {
    double value[VALUES], velocity;
    int kind;
    fmi2CallbackFunctions call;
} Model;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean log) {
    Model *m = calloc(1, sizeof *m);
    m->value[K] = m->value[X0] = m->value[MU] = 1.0;
    m->value[VDP] = 2.0;
    m->call = *call;
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stopped, fmi2Real stop) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Model *m = c;
    m->value[X] = m->value[X0];
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return fmi2OK; }

static void pol(double mu, const double y[2], double slope[2]) {
    slope[0] = y[1];
    slope[1] = mu * (1.0 - y[0] * y[0]) * y[1] - y[0];
}
static void runge_kutta(double mu, double y[2], double dt) {
    double k[4][2], z[2];
    const double part[3] = {0.5, 0.5, 1.0};
    pol(mu, y, k[0]);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 2; j++) z[j] = y[j] + part[i] * dt * k[i][j];
        pol(mu, z, k[i + 1]);
    }
    for (int j = 0; j < 2; j++) y[j] += dt / 6.0 * (k[0][j] + 2.0 * k[1][j] + 2.0 * k[2][j] + k[3][j]);
}

static fmi2Status failure(Model *m) {
    switch (m->kind) {
    case DISCARD: return fmi2Discard;
    case FATAL: return fmi2Fatal;
    case NO_NUMBER: return m->value[X] = nan(""), fmi2OK;
    case CRASH: raise(SIGSEGV);
    case HANG: for (volatile int on = 1; on;) {}
    default: return fmi2Error;
    }
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real dt, fmi2Boolean keep) {
    Model *m = c;
    double *v = m->value, y[2] = {v[VDP], m->velocity}, forced = v[U] / v[K];
    v[X] = forced + (v[X] - forced) * exp(-v[K] * dt);
    for (int i = 0; i < 10; i++) runge_kutta(v[MU], y, dt / 10.0);
    v[VDP] = y[0];
    m->velocity = y[1];
    if (now < 0.5 || fmod(v[K] * 1000.0, 1.0) >= v[SHARE]) return fmi2OK;
    m->call.logger(m->call.componentEnvironment, "decay", fmi2Error, "logStatusError", "no solution at k = %g", v[K]);
    return failure(m);
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) m->value[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->kind;
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->kind = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    return *value = fmi2False, fmi2OK;
}
