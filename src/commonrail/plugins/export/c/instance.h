/* One instance of an FMU, common to both versions of the standard and to all that an FMU can be: what its variables are is
 * in Kept and Seen of cr_fmu.h, which includes this header. */
#ifndef CR_INSTANCE
#define CR_INSTANCE
typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Phase;

typedef struct {
    Kept kept;
    void *state;
    size_t size;
    Seen seen;
    int observed; /* seen is that of the present state */
    const char *sentence; /* of the last failure */
    char *name;
    void *environment; /* of the importer: its logger and what the logger wants */
    void (*logger)(void);
} Instance;

Instance *fmu_new(const char *name);
void fmu_free(Instance *m);
int fmu_sized(Instance *m, size_t size); /* 0: no memory for a state of so many bytes */
void fmu_preset(Instance *m);
double *fmu_writable(Instance *m, unsigned reference); /* NULL: no such number, or not now */
int fmu_read(Instance *m, unsigned reference, double *value); /* 0: no such number */
int fmu_begin(Instance *m); /* a status */
int fmu_too_long(const Instance *m, double length); /* 1: more than MOST_STEPS inner steps */
int fmu_step(Instance *m, double now, double length); /* a status */

/* States kept for the importer; the functions return 0 where they fail. */
int fmu_get_state(const Instance *m, void **kept); /* writes over one of the same size */
int fmu_set_state(Instance *m, const void *kept);
void fmu_free_state(void **kept);
size_t fmu_state_size(const void *kept);
int fmu_write_state(const void *kept, void *bytes, size_t size);
int fmu_read_state(void **kept, const void *bytes, size_t size);
#endif
