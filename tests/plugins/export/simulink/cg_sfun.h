/* In place of Simulink: runs a block with 10 us of sample time for 3 ms, energised from 0 to 700 us, and prints what it
 * has injected; an argument takes the place of the sample time. */
#include <stdio.h>
#include <stdlib.h>

int main(int count, char **words) {
    double sample = count > 1 ? atof(words[1]) : 10e-6, step = 1e-6, rest[3] = {160e6, 5e6, 0.5e6};
    double boundary[4] = {160e6, 5e6, 0.5e6, 0.0}, command = 0.0;
    mxArray given[4] = {{1, &sample}, {1, &step}, {3, rest}, {0, NULL}};
    SimStruct S;
    memset(&S, 0, sizeof S);
    S.given = given;
    S.count = 4;
    mdlInitializeSizes(&S);
    if (!S.error) mdlInitializeSampleTimes(&S);
    if (S.error) return puts(S.error), 1;
    S.work = calloc((size_t)S.work_width, sizeof(double));
    S.out = calloc((size_t)S.out_width, sizeof(double));
    S.in[0] = boundary;
    S.in[1] = &command;
    mdlStart(&S);
    for (int k = 0; k < 300 && !S.error; k++) {
        command = k < 70;
        mdlOutputs(&S, 0);
        mdlUpdate(&S, 0);
    }
    mdlOutputs(&S, 0);
    printf("%.17g %d %g %s\n", S.out[0], S.out_width, S.sample, S.error ? S.error : "");
    mdlTerminate(&S);
    free(S.work);
    free(S.out);
    return 0;
}
