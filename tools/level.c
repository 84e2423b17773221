/* Level of x86-64 that this processor and its system support: 4 (AVX-512), 3 (AVX2 and FMA) or 0. */
int cr_level(void);

__attribute__((visibility("default"))) int cr_level(void) {
    __builtin_cpu_init();
    if (__builtin_cpu_supports("x86-64-v4")) return 4;
    return __builtin_cpu_supports("x86-64-v3") ? 3 : 0;
}
