// One constant in each target of a splat: nothing but the blend is paid for.
out vec4 sheet_front;
#ifdef TWO_TARGETS
out vec4 sheet_back;
#endif
#ifdef WEIGHT
out vec4 weight_front;
#ifdef TWO_TARGETS
out vec4 weight_back;
#endif
#endif

void main() {
    sheet_front = vec4(0.001);
#ifdef TWO_TARGETS
    sheet_back = vec4(0.001);
#endif
#ifdef WEIGHT
    weight_front = vec4(0.001);
#ifdef TWO_TARGETS
    weight_back = vec4(0.001);
#endif
#endif
}
