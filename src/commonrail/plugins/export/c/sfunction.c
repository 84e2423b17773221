/* The injector as a block of Simulink: an S-function of level 2. In MATLAB, in this folder:
 *
 *     mex cr_sfunction.c cr.c FOLDER/cr_kernel_PLATFORM.o
 *
 * Parameters of the block: sample time [s]; time step [s], of which a sample time is a whole number; pressures at rest
 * [rail, cylinder, return] [Pa]; CR_PARAMETERS parameters of the injector, or [] for those of the model's file.
 * Input 1: rail, cylinder and return pressure [Pa] and, of an injector driven by a trace, coil voltage [V] or current [A].
 * Input 2: command; the solenoid is energised while it is above 0.5. Output: the channels, in the header's order.
 * Inputs are held over a sample time. The simulation is a work vector, so that operating points and fast restart keep it.
 */
#define S_FUNCTION_NAME cr_sfunction
#define S_FUNCTION_LEVEL 2
#include <math.h>
#include "simstruc.h"
#include "cr_commonrail.h"

enum { SAMPLE, STEP, AT_REST, VALUES, GIVEN };

static double number(SimStruct *S, int which) { return mxGetScalar(ssGetSFcnParam(S, which)); }

static int steps_of(SimStruct *S) { return (int)floor(number(S, SAMPLE) / number(S, STEP) + 0.5); }

static void values_of(SimStruct *S, double *parameters) {
    const mxArray *given = ssGetSFcnParam(S, VALUES);
    cr_defaults(parameters);
    for (size_t i = 0; i < CR_PARAMETERS && mxGetNumberOfElements(given) == CR_PARAMETERS; i++)
        parameters[i] = mxGetPr(given)[i];
}

static const char *objection(SimStruct *S) {
    size_t values = mxGetNumberOfElements(ssGetSFcnParam(S, VALUES));
    double steps = number(S, SAMPLE) / number(S, STEP);
    if (!(steps > 0.5) || !(fabs(steps - floor(steps + 0.5)) < 1e-6))
        return "The sample time is no whole number of time steps; change one of them.";
    if (mxGetNumberOfElements(ssGetSFcnParam(S, AT_REST)) != 3)
        return "Pressures at rest are three numbers: rail, cylinder and return pressure [Pa].";
    if (values && values != CR_PARAMETERS) return "The parameters must be as many as the header says, or [].";
    return NULL;
}

static void mdlInitializeSizes(SimStruct *S) {
    double parameters[CR_PARAMETERS];
    const char *wrong;
    ssSetNumSFcnParams(S, GIVEN);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) return;
    for (int i = 0; i < GIVEN; i++) ssSetSFcnParamTunable(S, i, 0);
    if ((wrong = objection(S)) != NULL) {
        ssSetErrorStatus(S, wrong);
        return;
    }
    values_of(S, parameters);
    size_t size = cr_state_size(parameters, number(S, STEP));
    if (!size) {
        ssSetErrorStatus(S, cr_sentence(CR_OUTSIDE_DOMAIN));
        return;
    }
    if (!ssSetNumInputPorts(S, 2) || !ssSetNumOutputPorts(S, 1)) return;
    ssSetInputPortWidth(S, 0, 4);
    ssSetInputPortWidth(S, 1, 1);
    for (int i = 0; i < 2; i++) {
        ssSetInputPortDirectFeedThrough(S, i, 0);
        ssSetInputPortRequiredContiguous(S, i, 1);
    }
    ssSetOutputPortWidth(S, 0, CR_CHANNELS);
    ssSetNumSampleTimes(S, 1);
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, (int)(size / sizeof(double)));
    ssSetDWorkDataType(S, 0, SS_DOUBLE);
    ssSetSimStateCompliance(S, USE_DEFAULT_SIM_STATE);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S) {
    ssSetSampleTime(S, 0, number(S, SAMPLE));
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct *S) {
    double parameters[CR_PARAMETERS];
    const double *rest = mxGetPr(ssGetSFcnParam(S, AT_REST));
    const cr_boundary at_rest = {rest[0], rest[1], rest[2], 0.0};
    values_of(S, parameters);
    int status = cr_begin(ssGetDWork(S, 0), (size_t)ssGetDWorkWidth(S, 0) * sizeof(double), parameters, &at_rest,
                          number(S, STEP), 0.0);
    if (status) ssSetErrorStatus(S, cr_sentence(status));
}

static void mdlOutputs(SimStruct *S, int_T tid) {
    (void)tid;
    cr_observe(ssGetDWork(S, 0), ssGetOutputPortRealSignal(S, 0));
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid) {
    void *state = ssGetDWork(S, 0);
    const real_T *in = ssGetInputPortRealSignal(S, 0);
    const cr_boundary boundary = {in[0], in[1], in[2], in[3]};
    (void)tid;
    int status = cr_switch(state, cr_time(state), ssGetInputPortRealSignal(S, 1)[0] > 0.5);
    if (!status) status = cr_march(state, steps_of(S), &boundary);
    if (status) ssSetErrorStatus(S, cr_sentence(status));
}

static void mdlTerminate(SimStruct *S) { (void)S; }

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
