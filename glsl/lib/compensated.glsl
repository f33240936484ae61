// Sums that keep what rounding takes away (Kahan), for stacks of so many slices that plain float32 sums drift.
// PRECISE is GLSL 4.00's "precise" where there is one: it forbids the compiler to cancel what only exact arithmetic would cancel.

void add(inout vec4 sum, inout vec4 error, vec4 term) {
    PRECISE vec4 wanted = term - error;
    PRECISE vec4 next = sum + wanted;
    PRECISE vec4 taken = next - sum;
    error = taken - wanted;
    sum = next;
}

// sum in x, error in y
void add(inout vec2 pair, float term) {
    PRECISE float wanted = term - pair.y;
    PRECISE float next = pair.x + wanted;
    PRECISE float taken = next - pair.x;
    pair = vec2(next, taken - wanted);
}
