// How kernels' values are counted in the sheets of fields that are divided by their weights.
#pragma once

namespace sheetsplat {

/// A kernel of value f adds c = (f - pivot) / half_range times its weight to D, so that at the ends of the range c is 1
/// or -1: there D and W are the same number but for the sign, however they are rounded, and where all kernels at a
/// point have the largest value, or all the least, (W grad D - D grad W) / W^2 is 0 to the last bit.
struct Counting {
    double pivot = 0.0;      ///< plan/pivot.hpp
    double half_range = 0.0; ///< 0: values are not counted so, but multiplied by weights in the sheets' unit

    /// What a kernel of a weight adds to D. plain: value times weight, in the sheets' unit.
    [[nodiscard]] float amount(double value, float weight, double plain) const {
        if (half_range == 0.0) {
            return static_cast<float>(plain);
        }
        const auto c = static_cast<float>((value - pivot) / half_range);
        return c * weight;
    }
};

} // namespace sheetsplat
