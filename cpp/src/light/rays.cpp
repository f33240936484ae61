#include "rays.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <glm/geometric.hpp>

namespace sheetsplat::light_march {

namespace {

constexpr int most_stretches = 64;

/// Each number joined with those up to `margin` before and behind it, `stride` apart, in every block of `count`.
void widen(std::vector<std::uint64_t>& bits, std::size_t stride, std::size_t count) {
    std::vector<std::uint64_t> own(count);
    for (std::size_t block = 0; block < bits.size(); block += stride * count) {
        for (std::size_t n = 0; n < stride; ++n) {
            std::uint64_t* line = bits.data() + block + n;
            for (std::size_t place = 0; place < count; ++place) {
                own[place] = line[place * stride];
            }
            for (std::size_t place = 0; place < count; ++place) {
                const std::size_t first = place - std::min<std::size_t>(place, Stretches::margin);
                const std::size_t last = std::min(place + Stretches::margin, count - 1);
                for (std::size_t other = first; other <= last; ++other) {
                    line[place * stride] |= own[other];
                }
            }
        }
    }
}

} // namespace

Between between(double place) {
    const double whole = std::floor(place);
    return {static_cast<int>(whole), static_cast<float>(place - whole)};
}

Rays::Rays(const LightVolume& grid, const Vec3& towards_light, double slice_spacing) {
    const std::array<std::size_t, 3> strides{1, grid.index(0, 1, 0), grid.index(0, 0, 1)};
    std::array<double, 3> towards{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        towards[axis] = glm::dot(towards_light, grid.per_step[axis]);
        along_ = std::abs(towards[axis]) > std::abs(towards[along_]) ? axis : along_;
    }
    planes_ = grid.counts[along_];
    plane_stride_ = strides[along_];
    backwards_ = towards[along_] > 0.0;
    const double per_plane = std::abs(towards[along_]);
    slices_ = 1.0 / (per_plane * slice_spacing);
    for (std::size_t n = 0; n < 2; ++n) {
        const std::size_t axis = n == 0 ? (along_ == 0 ? 1 : 0) : (along_ == 2 ? 1 : 2);
        Axis& across = n == 0 ? columns_ : rows_;
        across.stride = strides[axis];
        across.elements = grid.counts[axis];
        across.per_plane = -towards[axis] / per_plane;
        const double shear = (planes_ - 1) * across.per_plane;
        across.first = std::max(0.0, shear) + 1.0;
        across.rays = across.elements + static_cast<int>(std::ceil(std::abs(shear))) + 4;
    }
}

Stretches::Stretches(const LightVolume& grid, std::size_t along, bool all) {
    const std::array<std::size_t, 3> counts{static_cast<std::size_t>(grid.counts[0]),
                                            static_cast<std::size_t>(grid.counts[1]),
                                            static_cast<std::size_t>(grid.counts[2])};
    const std::size_t columns = counts[along == 0 ? 1 : 0], rows = counts[along == 2 ? 1 : 2];
    rows_ = static_cast<int>(rows);
    while (static_cast<std::size_t>(length_) * most_stretches < columns) {
        length_ *= 2;
    }
    const auto stretch = [this](std::size_t column) { return column / static_cast<std::size_t>(length_); };
    if (all) {
        const std::size_t last = stretch(columns - 1);
        bits_.assign(counts[along] * rows, ~std::uint64_t{0} >> (most_stretches - 1 - last));
        return;
    }
    bits_.assign(counts[along] * rows, 0);
    std::vector<std::uint64_t> around(along == 0 ? columns : 0);
    for (std::size_t column = 0; column < around.size(); ++column) {
        around[column] = std::uint64_t{1} << stretch(column - std::min<std::size_t>(column, margin)) |
                         std::uint64_t{1} << stretch(std::min(column + margin, columns - 1));
    }
    // Of a layer, for each element along x, which is a plane then.
    std::vector<std::uint64_t> layer(along == 0 ? counts[0] : 0);
    const float* from = grid.values.data();
    for (std::size_t z = 0; z < counts[2]; ++z) {
        for (std::size_t y = 0; y < counts[1]; ++y, from += counts[0]) {
            if (along == 0) {
                const std::uint64_t own = around[y];
                for (std::size_t x = 0; x < counts[0]; ++x) {
                    layer[x] |= from[x] != 0.0F ? own : 0;
                }
                continue;
            }
            std::uint64_t found = 0;
            for (std::size_t number = 0; number <= stretch(columns - 1); ++number) {
                const std::size_t begin = number * static_cast<std::size_t>(length_);
                const std::size_t end = std::min(begin + static_cast<std::size_t>(length_ + margin), columns);
                // (Bits are joined: such a loop becomes vectors, one that stops does not.)
                std::uint32_t any = 0;
                for (std::size_t x = begin - std::min<std::size_t>(begin, margin); x < end; ++x) {
                    std::uint32_t own = 0;
                    std::memcpy(&own, from + x, sizeof(own));
                    any |= own;
                }
                found |= static_cast<std::uint64_t>(any != 0 ? 1 : 0) << number;
            }
            bits_[along == 1 ? y * rows + z : z * rows + y] = found;
        }
        for (std::size_t x = 0; x < layer.size(); ++x) {
            bits_[x * rows + z] = layer[x];
            layer[x] = 0;
        }
    }
    widen(bits_, 1, rows);
    widen(bits_, rows, counts[along]);
}

} // namespace sheetsplat::light_march
