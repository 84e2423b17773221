/* Instance of an FMU: its memory, and states kept for the importer. */
#include "cr_fmu.h"
#include <stdlib.h>
#include <string.h>

typedef struct { /* a kept state; the numbers of the simulation, if it has begun, follow it */
    uint64_t size; /* of both */
    Kept kept;
} Snapshot;

Instance *fmu_new(const char *name) {
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    if (!name) name = "";
    m->name = malloc(strlen(name) + 1);
    if (!m->name) {
        free(m);
        return NULL;
    }
    strcpy(m->name, name);
    fmu_preset(m);
    return m;
}

void fmu_free(Instance *m) {
    if (!m) return;
    free(m->state);
    free(m->name);
    free(m);
}

int fmu_sized(Instance *m, size_t size) {
    if (m->state && m->size == size) return 1;
    void *state = malloc(size);
    if (!state) return 0;
    free(m->state);
    m->state = state;
    m->size = size;
    return 1;
}

int fmu_get_state(const Instance *m, void **kept) {
    size_t size = sizeof(Snapshot) + (m->state ? m->size : 0);
    Snapshot *s = *kept && fmu_state_size(*kept) == size ? *kept : realloc(*kept, size);
    if (!s) return 0;
    memset(s, 0, sizeof *s);
    s->size = size;
    s->kept = m->kept;
    if (m->state) memcpy(s + 1, m->state, m->size);
    *kept = s;
    return 1;
}

int fmu_set_state(Instance *m, const void *kept) {
    const Snapshot *s = kept;
    size_t held = (size_t)s->size - sizeof *s;
    if (s->size < sizeof *s || (held && !fmu_sized(m, held))) return 0;
    if (held) memcpy(m->state, s + 1, held);
    m->kept = s->kept;
    if (!held) m->kept.dirty = 1;
    m->observed = 0;
    m->sentence = NULL;
    return 1;
}

void fmu_free_state(void **kept) {
    if (!kept) return;
    free(*kept);
    *kept = NULL;
}

size_t fmu_state_size(const void *kept) { return (size_t)((const Snapshot *)kept)->size; }

int fmu_write_state(const void *kept, void *bytes, size_t size) {
    if (size < fmu_state_size(kept)) return 0;
    memcpy(bytes, kept, fmu_state_size(kept));
    return 1;
}

int fmu_read_state(void **kept, const void *bytes, size_t size) {
    Snapshot head;
    if (!bytes || size < sizeof head) return 0;
    memcpy(&head, bytes, sizeof head);
    if (head.size > size || head.size < sizeof head) return 0;
    void *to = realloc(*kept, size);
    if (!to) return 0;
    memcpy(to, bytes, size);
    *kept = to;
    return 1;
}
