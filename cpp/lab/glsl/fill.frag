// One constant per target: nothing but the blend is paid for.
out vec4 fill_0;
#if TARGETS > 1
out vec4 fill_1;
#endif
#if TARGETS > 2
out vec4 fill_2;
#endif
#if TARGETS > 3
out vec4 fill_3;
#endif

void main() {
    fill_0 = vec4(0.001);
#if TARGETS > 1
    fill_1 = vec4(0.001);
#endif
#if TARGETS > 2
    fill_2 = vec4(0.001);
#endif
#if TARGETS > 3
    fill_3 = vec4(0.001);
#endif
}
