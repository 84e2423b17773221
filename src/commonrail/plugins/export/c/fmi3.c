/* FMI 3.0 co-simulation around an instance. */
#include "fmi3Functions.h"
#include "cr_fmu.h"
#include <math.h>
#include <string.h>

static void say(Instance *m, fmi3Status status, const char *text) {
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)m->logger;
    if (logger) logger(m->environment, status, "logStatusError", text ? text : "failed");
}
static fmi3Status refuse(Instance *m, const char *text) {
    if (m) say(m, fmi3Error, text);
    return fmi3Error;
}

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)on, (void)n, (void)categories;
    return c ? fmi3OK : fmi3Error;
}

static Instance *instance(fmi3String name, fmi3String token, fmi3InstanceEnvironment environment,
                          fmi3LogMessageCallback log, const char *refusal) {
    Instance *m = fmu_new(name);
    if (!m) return NULL;
    m->logger = (void (*)(void))log;
    m->environment = environment;
    if (!refusal && !(token && !strcmp(token, CR_GUID)))
        refusal = "The instantiation token is not that of this FMU's modelDescription.xml.";
    if (!refusal) return m;
    say(m, fmi3Error, refusal);
    fmu_free(m);
    return NULL;
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)place, (void)visible, (void)logging, (void)early, (void)required, (void)n, (void)update;
    return instance(name, token, environment, log, events ? "This FMU has no event mode." : NULL);
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String place, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    (void)place, (void)visible, (void)logging;
    return instance(name, token, environment, log, "This FMU is for co-simulation only.");
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String place,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    (void)place, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    return instance(name, token, environment, log, "This FMU is for co-simulation only.");
}
void fmi3FreeInstance(fmi3Instance c) { fmu_free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean given, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stopped, fmi3Float64 stop) {
    (void)given, (void)tolerance, (void)stopped, (void)stop;
    Instance *m = c;
    if (!m || m->kept.phase != INSTANTIATED || !isfinite(start)) return refuse(m, "The initialization cannot begin now.");
    m->kept.begun = m->kept.time = start;
    m->kept.phase = INITIALISING;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    Instance *m = c;
    if (!m || m->kept.phase != INITIALISING) return refuse(m, "There is no initialization to end.");
    if (m->kept.dirty && fmu_begin(m)) return refuse(m, m->sentence);
    m->kept.phase = STEPPING;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) {
    Instance *m = c;
    if (!m || m->kept.phase != STEPPING) return refuse(m, "There is nothing to terminate.");
    m->kept.phase = TERMINATED;
    return fmi3OK;
}
fmi3Status fmi3Reset(fmi3Instance c) {
    Instance *m = c;
    if (!m) return fmi3Error;
    fmu_preset(m);
    m->sentence = NULL;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 now, fmi3Float64 length, fmi3Boolean keep, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    (void)keep;
    Instance *m = c;
    if (event) *event = fmi3False;
    if (terminate) *terminate = fmi3False;
    if (early) *early = fmi3False;
    if (!m || m->kept.phase != STEPPING || !(length > 0.0) || !isfinite(now + length))
        return refuse(m, "No step can be taken now, or its length is not positive.");
    if (fmu_too_long(m, length)) return refuse(m, TOO_LONG);
    int status = fmu_step(m, now, length);
    if (reached) *reached = m->kept.time;
    if (!status) return fmi3OK;
    if (terminate) *terminate = fmi3True;
    say(m, fmi3Discard, m->sentence);
    return fmi3Discard;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[], size_t count) {
    Instance *m = c;
    if (!m || count != n) return refuse(m, "Every variable has one value.");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == VR_TIME) value[i] = m->kept.time;
        else if (vr[i] >= VR_OPEN || !fmu_read(m, vr[i], value + i))
            return refuse(m, "There is no Float64 variable of that reference.");
    }
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t count) {
    Instance *m = c;
    if (!m || count != n) return refuse(m, "Every variable has one value.");
    for (size_t i = 0; i < n; i++) {
        double *to = fmu_writable(m, vr[i]);
        if (!to) return refuse(m, "A variable is no parameter or input, or a parameter is set after the initialization.");
        if (!isfinite(value[i])) return refuse(m, "A value is not finite.");
        *to = value[i];
    }
    return fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean value[], size_t count) {
    Instance *m = c;
    double number;
    if (!m || count != n) return refuse(m, "Every variable has one value.");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == VR_COMMAND) value[i] = m->kept.command != 0;
        else if (vr[i] == VR_OPEN && fmu_read(m, vr[i], &number)) value[i] = number != 0.0;
        else return refuse(m, "There is no Boolean variable of that reference.");
    }
    return fmi3OK;
}
fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean value[],
                          size_t count) {
    Instance *m = c;
    if (!m || count != n) return refuse(m, "Every variable has one value.");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != VR_COMMAND) return refuse(m, "There is no Boolean input of that reference.");
        m->kept.command = value[i] ? 1 : 0;
    }
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 value[], size_t count) {
    Instance *m = c;
    double number;
    if (!m || count != n) return refuse(m, "Every variable has one value.");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != VR_STATUS || !fmu_read(m, vr[i], &number)) return refuse(m, "There is no Int32 of that reference.");
        value[i] = (fmi3Int32)number;
    }
    return fmi3OK;
}

/* Kinds of variables that there are none of. */
#define NONE(name, type)                                                                                              \
    fmi3Status name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type value[], size_t count) {             \
        (void)vr, (void)value, (void)count;                                                                            \
        return n ? refuse(c, "There are no variables of this type.") : fmi3OK;                                         \
    }
NONE(fmi3GetFloat32, fmi3Float32)
NONE(fmi3GetInt8, fmi3Int8)
NONE(fmi3GetUInt8, fmi3UInt8)
NONE(fmi3GetInt16, fmi3Int16)
NONE(fmi3GetUInt16, fmi3UInt16)
NONE(fmi3GetUInt32, fmi3UInt32)
NONE(fmi3GetInt64, fmi3Int64)
NONE(fmi3GetUInt64, fmi3UInt64)
NONE(fmi3GetString, fmi3String)
NONE(fmi3SetFloat32, const fmi3Float32)
NONE(fmi3SetInt8, const fmi3Int8)
NONE(fmi3SetUInt8, const fmi3UInt8)
NONE(fmi3SetInt16, const fmi3Int16)
NONE(fmi3SetUInt16, const fmi3UInt16)
NONE(fmi3SetInt32, const fmi3Int32)
NONE(fmi3SetUInt32, const fmi3UInt32)
NONE(fmi3SetInt64, const fmi3Int64)
NONE(fmi3SetUInt64, const fmi3UInt64)
NONE(fmi3SetString, const fmi3String)
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary value[],
                         size_t count) {
    (void)vr, (void)sizes, (void)value, (void)count;
    return n ? refuse(c, "There are no variables of this type.") : fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary value[], size_t count) {
    (void)vr, (void)sizes, (void)value, (void)count;
    return n ? refuse(c, "There are no variables of this type.") : fmi3OK;
}
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock value[]) {
    (void)vr, (void)value;
    return n ? refuse(c, "There are no clocks.") : fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[]) {
    (void)vr, (void)value;
    return n ? refuse(c, "There are no clocks.") : fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *kept) {
    return c && kept && fmu_get_state(c, kept) ? fmi3OK : refuse(c, "There is no memory for a state.");
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState kept) {
    return c && kept && fmu_set_state(c, kept) ? fmi3OK : refuse(c, "This is no state of this FMU.");
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *kept) {
    (void)c;
    fmu_free_state(kept);
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState kept, size_t *size) {
    if (!c || !kept || !size) return fmi3Error;
    *size = fmu_state_size(kept);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState kept, fmi3Byte bytes[], size_t size) {
    return c && kept && fmu_write_state(kept, bytes, size) ? fmi3OK : refuse(c, "The memory is too small for the state.");
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *kept) {
    return c && kept && fmu_read_state(kept, bytes, size) ? fmi3OK : refuse(c, "There is no memory for a state.");
}

/* What this FMU cannot do: its description says so, and importers do not ask. */
#define REFUSED(name, ...) \
    fmi3Status name(fmi3Instance c, __VA_ARGS__) { return refuse(c, "This FMU cannot do that."); }
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
REFUSED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference v, size_t *n)
REFUSED(fmi3GetVariableDependencies, fmi3ValueReference v, size_t e[], fmi3ValueReference i[], size_t f[],
        fmi3DependencyKind k[], size_t n)
REFUSED(fmi3GetDirectionalDerivative, const fmi3ValueReference u[], size_t nu, const fmi3ValueReference k[], size_t nk,
        const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd)
REFUSED(fmi3GetAdjointDerivative, const fmi3ValueReference u[], size_t nu, const fmi3ValueReference k[], size_t nk,
        const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd)
REFUSED(fmi3GetIntervalDecimal, const fmi3ValueReference v[], size_t n, fmi3Float64 i[], fmi3IntervalQualifier q[])
REFUSED(fmi3GetIntervalFraction, const fmi3ValueReference v[], size_t n, fmi3UInt64 k[], fmi3UInt64 r[],
        fmi3IntervalQualifier q[])
REFUSED(fmi3GetShiftDecimal, const fmi3ValueReference v[], size_t n, fmi3Float64 s[])
REFUSED(fmi3GetShiftFraction, const fmi3ValueReference v[], size_t n, fmi3UInt64 k[], fmi3UInt64 r[])
REFUSED(fmi3SetIntervalDecimal, const fmi3ValueReference v[], size_t n, const fmi3Float64 i[])
REFUSED(fmi3SetIntervalFraction, const fmi3ValueReference v[], size_t n, const fmi3UInt64 k[], const fmi3UInt64 r[])
REFUSED(fmi3SetShiftDecimal, const fmi3ValueReference v[], size_t n, const fmi3Float64 s[])
REFUSED(fmi3SetShiftFraction, const fmi3ValueReference v[], size_t n, const fmi3UInt64 k[], const fmi3UInt64 r[])
REFUSED(fmi3UpdateDiscreteStates, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f,
        fmi3Float64 *t)
REFUSED(fmi3CompletedIntegratorStep, fmi3Boolean k, fmi3Boolean *e, fmi3Boolean *t)
REFUSED(fmi3SetTime, fmi3Float64 t)
REFUSED(fmi3SetContinuousStates, const fmi3Float64 s[], size_t n)
REFUSED(fmi3GetContinuousStateDerivatives, fmi3Float64 d[], size_t n)
REFUSED(fmi3GetEventIndicators, fmi3Float64 e[], size_t n)
REFUSED(fmi3GetContinuousStates, fmi3Float64 s[], size_t n)
REFUSED(fmi3GetNominalsOfContinuousStates, fmi3Float64 s[], size_t n)
REFUSED(fmi3GetNumberOfEventIndicators, size_t *n)
REFUSED(fmi3GetNumberOfContinuousStates, size_t *n)
REFUSED(fmi3GetOutputDerivatives, const fmi3ValueReference v[], size_t n, const fmi3Int32 o[], fmi3Float64 d[], size_t m)
REFUSED(fmi3ActivateModelPartition, fmi3ValueReference k, fmi3Float64 t)
#define REFUSED_MODE(name) \
    fmi3Status name(fmi3Instance c) { return refuse(c, "This FMU has no such mode."); }
REFUSED_MODE(fmi3EnterEventMode)
REFUSED_MODE(fmi3EnterConfigurationMode)
REFUSED_MODE(fmi3ExitConfigurationMode)
REFUSED_MODE(fmi3EvaluateDiscreteStates)
REFUSED_MODE(fmi3EnterContinuousTimeMode)
REFUSED_MODE(fmi3EnterStepMode)
