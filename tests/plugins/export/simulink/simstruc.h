/* The few functions of Simulink's header that the S-function calls, written for the tests: MATLAB is not needed. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef double real_T;
typedef int int_T;
typedef struct {
    size_t count;
    double *numbers;
} mxArray;
typedef struct {
    const mxArray *given;
    int count, expected, inputs, outputs, widths[2], out_width, work_width, samples, works;
    double *in[2], *out, *work, sample, offset;
    const char *error;
} SimStruct;

#define SS_DOUBLE 0
#define USE_DEFAULT_SIM_STATE 1
#define SS_OPTION_EXCEPTION_FREE_CODE 1

static double mxGetScalar(const mxArray *a) { return a->numbers[0]; }
static double *mxGetPr(const mxArray *a) { return a->numbers; }
static size_t mxGetNumberOfElements(const mxArray *a) { return a->count; }
static const mxArray *ssGetSFcnParam(SimStruct *S, int i) { return S->given + i; }
static void ssSetNumSFcnParams(SimStruct *S, int count) { S->expected = count; }
static int ssGetNumSFcnParams(SimStruct *S) { return S->expected; }
static int ssGetSFcnParamsCount(SimStruct *S) { return S->count; }
static void ssSetSFcnParamTunable(SimStruct *S, int i, int is) { (void)S, (void)i, (void)is; }
static void ssSetErrorStatus(SimStruct *S, const char *text) { S->error = text; }
static int ssSetNumInputPorts(SimStruct *S, int count) { return S->inputs = count; }
static int ssSetNumOutputPorts(SimStruct *S, int count) { return S->outputs = count; }
static void ssSetInputPortWidth(SimStruct *S, int i, int width) { S->widths[i] = width; }
static void ssSetOutputPortWidth(SimStruct *S, int i, int width) { (void)i, S->out_width = width; }
static void ssSetInputPortDirectFeedThrough(SimStruct *S, int i, int is) { (void)S, (void)i, (void)is; }
static void ssSetInputPortRequiredContiguous(SimStruct *S, int i, int is) { (void)S, (void)i, (void)is; }
static void ssSetNumSampleTimes(SimStruct *S, int count) { S->samples = count; }
static void ssSetNumDWork(SimStruct *S, int count) { S->works = count; }
static void ssSetDWorkWidth(SimStruct *S, int i, int width) { (void)i, S->work_width = width; }
static void ssSetDWorkDataType(SimStruct *S, int i, int kind) { (void)S, (void)i, (void)kind; }
static void ssSetSimStateCompliance(SimStruct *S, int kind) { (void)S, (void)kind; }
static void ssSetOptions(SimStruct *S, int options) { (void)S, (void)options; }
static void ssSetSampleTime(SimStruct *S, int i, double time) { (void)i, S->sample = time; }
static void ssSetOffsetTime(SimStruct *S, int i, double time) { (void)i, S->offset = time; }
static void *ssGetDWork(SimStruct *S, int i) { return (void)i, S->work; }
static int ssGetDWorkWidth(SimStruct *S, int i) { return (void)i, S->work_width; }
static real_T *ssGetOutputPortRealSignal(SimStruct *S, int i) { return (void)i, S->out; }
static const real_T *ssGetInputPortRealSignal(SimStruct *S, int i) { return S->in[i]; }
