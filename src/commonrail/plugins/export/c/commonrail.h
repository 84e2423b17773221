/* One injector as a C library: the compiled physics of commonrail, without Python.
 *
 * All numbers are in SI units. A simulation is one block of memory that the caller owns (cr_state_size): copy its bytes
 * to keep a state, copy them back to return to it. The functions hold no other memory, allocate nothing, and may run in
 * any number of threads, each with a block of its own. Energisings are planned (cr_plan) or switched (cr_switch).
 */
#ifndef CR_HEADER
#define CR_HEADER
#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32) && defined(CR_SHARED)
#define CR_API __declspec(dllexport)
#elif defined(__GNUC__) && defined(CR_SHARED)
#define CR_API __attribute__((visibility("default")))
#else
#define CR_API
#endif
#ifdef __cplusplus
extern "C" {
#endif

/*SIZES*/
/* Boundaries of the injector, held over the steps of a call. CR_READS_… says which of them this model reads. */
typedef struct cr_boundary {
    double rail_pressure;     /* [Pa]; where the rail is a volume, of its state at rest only */
    double cylinder_pressure; /* [Pa] */
    double return_pressure;   /* [Pa] */
    double drive;             /* coil voltage [V] or current [A] of an injector driven by a trace; else not read */
} cr_boundary;

/* One energising of the solenoid: start and duration [s]. */
typedef struct cr_energising {
    double start, duration;
} cr_energising;

/* Inputs of one step: mean boundary pressures [Pa], mean drive, time since the present energising began and since it
 * ended [s], both at the start of the step and negative before. */
typedef struct cr_inputs {
    double rail, cylinder, low, trace, since_start, since_end;
} cr_inputs;

/* Figures of a simulation so far; instants are in s and NaN where there is none, masses in kg, lifts in m. */
typedef struct cr_figures {
    double injected, returned, supplied;
    double opening, closing, first_closing; /* of the needle */
    double greatest_lift;
    double reference_density; /* of the fuel at the cylinder pressure at rest [kg/m3] */
} cr_figures;

enum {
    CR_OK = 0,
    CR_NOT_CLOSED_AT_START = 1,
    CR_STEP_UNSTABLE = 2,
    CR_RAN_AWAY = 3,
    CR_NOT_FINITE = 4,
    CR_STILL_INJECTING = 5, /* no failure: the needle has not closed yet */
    CR_OUTSIDE_DOMAIN = 6,
    CR_BAD_BOUNDARY = 16, /* a boundary pressure outside the fuel's range, or not below the rail pressure */
    CR_BAD_PLAN = 17,     /* energisings that overlap, run backwards or are too many */
    CR_BAD_MEMORY = 18    /* no memory, too little of it, or not a state of this model */
};

/* Parameters: number, name, unit, and their values in the model's file. The last one is the fuel's temperature. */
CR_API const char *cr_parameter_name(int index);
CR_API const char *cr_parameter_unit(int index);
CR_API int cr_parameter_index(const char *name); /* -1: there is none of that name */
CR_API void cr_defaults(double parameters[CR_PARAMETERS]);
CR_API const char *cr_channel_name(int index);
CR_API const char *cr_channel_unit(int index);

/* Status of parameters, boundaries and time step before a simulation; `wrong`, if given, receives the index of the
 * parameter that lies outside its domain, or -1. */
CR_API int cr_check(const double parameters[CR_PARAMETERS], const cr_boundary *at_rest, double time_step, int *wrong);
/* Longest time step that the parameters bear [s]; 0 where none does. */
CR_API double cr_longest_step(const double parameters[CR_PARAMETERS], const cr_boundary *at_rest);
/* Bytes of a simulation with these parameters and this time step; 0 where they are outside their domains. */
CR_API size_t cr_state_size(const double parameters[CR_PARAMETERS], double time_step);

/* Begin at rest, at `start` seconds; `state` must be aligned for doubles. Returns a status. */
CR_API int cr_begin(void *state, size_t size, const double parameters[CR_PARAMETERS], const cr_boundary *at_rest,
                    double time_step, double start);
/* Plan energisings, in order, in place of all that were planned or switched; at most CR_ENERGISINGS. */
CR_API int cr_plan(void *state, const cr_energising *energisings, int count);
/* Switch the energising on or off at a time that has not been simulated yet. Switched on while the needle is closed, the
 * instants of cr_figures are those of the injection that follows. */
CR_API int cr_switch(void *state, double time, int on);
/* March `steps` time steps. Returns CR_OK or the failure, after which the state stands still. */
CR_API int cr_march(void *state, int64_t steps, const cr_boundary *boundary);
/* March with the inputs of each step given. */
CR_API int cr_march_inputs(void *state, int64_t steps, const cr_inputs *inputs);

CR_API double cr_time(const void *state);  /* [s] */
CR_API int64_t cr_steps(const void *state);
CR_API int cr_status(const void *state);   /* CR_STILL_INJECTING while the needle is open */
CR_API const char *cr_sentence(int status); /* the status in words, with the cure */
CR_API void cr_observe(const void *state, double channels[CR_CHANNELS]);
CR_API void cr_read_figures(const void *state, cr_figures *figures);

#ifdef __cplusplus
}
#endif
#endif
