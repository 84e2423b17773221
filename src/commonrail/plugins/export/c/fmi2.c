/* FMI 2.0 co-simulation around an instance. */
#include "fmi2Functions.h"
#include "cr_fmu.h"
#include <math.h>
#include <string.h>

static void say(Instance *m, fmi2Status status, const char *text) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)m->logger;
    if (logger) logger(m->environment, m->name, status, "logStatusError", "%s", text ? text : "failed");
}
static fmi2Status refuse(Instance *m, const char *text) {
    if (m) say(m, fmi2Error, text);
    return fmi2Error;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)on, (void)n, (void)categories;
    return c ? fmi2OK : fmi2Error;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean log) {
    (void)place, (void)visible, (void)log;
    Instance *m = fmu_new(name);
    if (!m) return NULL;
    if (call) {
        m->logger = (void (*)(void))call->logger;
        m->environment = call->componentEnvironment;
    }
    if (type == fmi2CoSimulation && guid && !strcmp(guid, CR_GUID)) return m;
    say(m, fmi2Error, type == fmi2CoSimulation ? "The GUID is not that of this FMU's modelDescription.xml."
                                               : "This FMU is for co-simulation only.");
    fmu_free(m);
    return NULL;
}
void fmi2FreeInstance(fmi2Component c) { fmu_free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stopped, fmi2Real stop) {
    (void)given, (void)tolerance, (void)stopped, (void)stop;
    Instance *m = c;
    if (!m || m->kept.phase != INSTANTIATED || !isfinite(start)) return refuse(m, "No experiment can be set up now.");
    m->kept.begun = m->kept.time = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *m = c;
    if (!m || m->kept.phase != INSTANTIATED) return refuse(m, "The initialization cannot begin now.");
    m->kept.phase = INITIALISING;
    return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *m = c;
    if (!m || m->kept.phase != INITIALISING) return refuse(m, "There is no initialization to end.");
    if (m->kept.dirty && fmu_begin(m)) return refuse(m, m->sentence);
    m->kept.phase = STEPPING;
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *m = c;
    if (!m || m->kept.phase != STEPPING) return refuse(m, "There is nothing to terminate.");
    m->kept.phase = TERMINATED;
    return fmi2OK;
}
fmi2Status fmi2Reset(fmi2Component c) {
    Instance *m = c;
    if (!m) return fmi2Error;
    fmu_preset(m);
    m->sentence = NULL;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real now, fmi2Real length, fmi2Boolean keep) {
    (void)keep;
    Instance *m = c;
    if (!m || m->kept.phase != STEPPING || !(length > 0.0) || !isfinite(now + length))
        return refuse(m, "No step can be taken now, or its length is not positive.");
    if (fmu_too_long(m, length)) return refuse(m, TOO_LONG);
    if (!fmu_step(m, now, length)) return fmi2OK;
    say(m, fmi2Discard, m->sentence);
    return fmi2Discard;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return refuse(c, "Steps are not taken asynchronously."); }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Instance *m = c;
    if (!m) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (vr[i] >= VR_OPEN || !fmu_read(m, vr[i], value + i)) return refuse(m, "There is no real variable of that reference.");
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Instance *m = c;
    if (!m) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        double *to = fmu_writable(m, vr[i]);
        if (!to) return refuse(m, "A variable is no parameter or input, or a parameter is set after the initialization.");
        if (!isfinite(value[i])) return refuse(m, "A value is not finite.");
        *to = value[i];
    }
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    Instance *m = c;
    double number;
    if (!m) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == VR_COMMAND) value[i] = m->kept.command;
        else if (vr[i] == VR_OPEN && fmu_read(m, vr[i], &number)) value[i] = number != 0.0;
        else return refuse(m, "There is no Boolean variable of that reference.");
    }
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    Instance *m = c;
    if (!m) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != VR_COMMAND) return refuse(m, "There is no Boolean input of that reference.");
        m->kept.command = value[i] != fmi2False;
    }
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    Instance *m = c;
    double number;
    if (!m) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != VR_STATUS || !fmu_read(m, vr[i], &number)) return refuse(m, "There is no integer of that reference.");
        value[i] = (fmi2Integer)number;
    }
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    (void)vr, (void)value;
    return n ? refuse(c, "There are no integers to be set.") : fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    (void)vr, (void)value;
    return n ? refuse(c, "There are no strings.") : fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    (void)vr, (void)value;
    return n ? refuse(c, "There are no strings.") : fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *kept) {
    return c && kept && fmu_get_state(c, kept) ? fmi2OK : refuse(c, "There is no memory for a state.");
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate kept) {
    return c && kept && fmu_set_state(c, kept) ? fmi2OK : refuse(c, "This is no state of this FMU.");
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *kept) {
    (void)c;
    fmu_free_state(kept);
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate kept, size_t *size) {
    if (!c || !kept || !size) return fmi2Error;
    *size = fmu_state_size(kept);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate kept, fmi2Byte bytes[], size_t size) {
    return c && kept && fmu_write_state(kept, bytes, size) ? fmi2OK : refuse(c, "The memory is too small for the state.");
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *kept) {
    return c && kept && fmu_read_state(kept, bytes, size) ? fmi2OK : refuse(c, "There is no memory for a state.");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t nu,
                                        const fmi2ValueReference k[], size_t nk, const fmi2Real dk[], fmi2Real du[]) {
    (void)u, (void)nu, (void)k, (void)nk, (void)dk, (void)du;
    return refuse(c, "There are no directional derivatives.");
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    return refuse(c, "Inputs are held over a step.");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    return refuse(c, "There are no derivatives of outputs.");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind, (void)value;
    return c ? fmi2Discard : fmi2Error;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    Instance *m = c;
    if (!m || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = m->kept.time;
    return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    return c ? fmi2Discard : fmi2Error;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    Instance *m = c;
    if (!m || kind != fmi2Terminated) return fmi2Discard;
    *value = m->sentence != NULL;
    return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind, (void)value;
    return c ? fmi2Discard : fmi2Error;
}

/* Functions of model exchange, which this FMU is not for: some importers look up all functions of the standard. */
static fmi2Status absent(fmi2Component c) { return refuse(c, "This FMU is for co-simulation only."); }
fmi2Status fmi2EnterEventMode(fmi2Component c) { return absent(c); }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return absent(c); }
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { return (void)time, absent(c); }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) { return (void)info, absent(c); }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) { return (void)x, (void)n, absent(c); }
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { return (void)x, (void)n, absent(c); }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    return (void)x, (void)n, absent(c);
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real x[], size_t n) { return (void)x, (void)n, absent(c); }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real x[], size_t n) { return (void)x, (void)n, absent(c); }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean kept, fmi2Boolean *mode, fmi2Boolean *ended) {
    return (void)kept, (void)mode, (void)ended, absent(c);
}
