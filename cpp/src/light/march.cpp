#include "light/march.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/instruction_set.hpp"
#include "rays.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "march.cpp"
#include "hwy/foreach_target.h"
// (foreach_target includes this file once for each set, ahead of the others.)
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::light_march::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

/// No set has more lanes. Runs of elements are multiples of it, and rows of memory are that much longer.
constexpr std::size_t most_lanes = 16;
/// Interpolation at a run reads so many elements around it.
constexpr std::size_t around_run = 4;
/// More than any absorption.
constexpr float boundless = 1e30F;

/// e^-x for x >= 0 with a relative error below 1e-6: 2^y for y = -x / ln 2 with y's whole part as exponent, and a
/// Taylor polynomial of the rest.
HWY_INLINE V left_of(D d, V absorbed) {
    const hn::RebindToSigned<D> di;
    // e^-x of more than 80 is 0.
    const V y = hn::Mul(hn::Min(absorbed, hn::Set(d, 80.0F)), hn::Set(d, -1.44269504F));
    const V whole = hn::Round(y);
    const V t = hn::Mul(hn::Sub(y, whole), hn::Set(d, 0.693147181F));
    const V one = hn::Set(d, 1.0F);
    V sum = hn::MulAdd(hn::Set(d, 1.0F / 720.0F), t, hn::Set(d, 1.0F / 120.0F));
    sum = hn::MulAdd(sum, t, hn::Set(d, 1.0F / 24.0F));
    sum = hn::MulAdd(sum, t, hn::Set(d, 1.0F / 6.0F));
    sum = hn::MulAdd(sum, t, hn::Set(d, 0.5F));
    sum = hn::MulAdd(hn::MulAdd(sum, t, one), t, one);
    const auto exponent = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, whole), hn::Set(di, 127)));
    return hn::Mul(hn::BitCast(d, exponent), sum);
}

/// What four numbers in a row count for a place between the two in the middle: Catmull and Rom's cubic, which keeps
/// what lines would smooth.
struct Cubic {
    D d;
    V w0, w1, w2, w3;
    explicit Cubic(float part) {
        const float p = part, p2 = p * p, p3 = p2 * p;
        w0 = hn::Set(d, -0.5F * p + p2 - 0.5F * p3);
        w1 = hn::Set(d, 1.0F - 2.5F * p2 + 1.5F * p3);
        w2 = hn::Set(d, 0.5F * p + 2.0F * p2 - 1.5F * p3);
        w3 = hn::Set(d, 0.5F * (p3 - p2));
    }
    [[nodiscard]] HWY_INLINE V of(V a, V b, V c, V e) const {
        return hn::MulAdd(w0, a, hn::MulAdd(w1, b, hn::MulAdd(w2, c, hn::Mul(w3, e))));
    }
    /// Of four rows.
    HWY_INLINE void mix(const std::array<const float*, 4>& from, std::size_t begin, std::size_t end, float* out) const {
        for (std::size_t n = begin; n < end; n += hn::Lanes(d)) {
            hn::StoreU(of(hn::LoadU(d, from[0] + n), hn::LoadU(d, from[1] + n), hn::LoadU(d, from[2] + n),
                          hn::LoadU(d, from[3] + n)),
                       d, out + n);
        }
    }
    /// Along a row, kept between 0 and `most`.
    [[nodiscard]] HWY_INLINE V along(const float* from, float most) const {
        const V sum = of(hn::LoadU(d, from), hn::LoadU(d, from + 1), hn::LoadU(d, from + 2), hn::LoadU(d, from + 3));
        return hn::Min(hn::Max(sum, hn::Zero(d)), hn::Set(d, most));
    }
};

constexpr std::size_t whole_vectors(std::size_t count) { return (count + most_lanes - 1) / most_lanes * most_lanes; }

/// A band of rows of rays, and their way from the elements of a plane to rays and back.
class Band {
  public:
    Band(const LightVolume& grid, const Rays& rays, const Stretches& near, std::size_t number)
        : grid_(grid), rays_(rays), near_(near), first_(static_cast<int>(number) * (band_rows - shared_rows)),
          count_(std::min(band_rows, rays.rows().rays - first_)),
          width_(whole_vectors(static_cast<std::size_t>(rays.columns().rays)) + 4 * most_lanes),
          padded_(whole_vectors(elements()) + 5 * most_lanes), lines_((band_rows + 3) * padded_, 0.0F),
          zeros_(padded_, 0.0F), mixed_(std::max(padded_, width_)), line_(std::max(padded_, width_)) {}

    [[nodiscard]] int rows() const { return count_; }
    /// Room for a row of rays.
    [[nodiscard]] std::size_t width() const { return width_; }
    [[nodiscard]] std::size_t elements() const { return static_cast<std::size_t>(rays_.columns().elements); }
    /// Of elements that are read or written one by one.
    [[nodiscard]] std::size_t stride() const { return rays_.columns().stride; }

    /// Where the plane's columns lie among the rays: element 0 at ray first_ray(), and the rays between elements.
    void enter(int plane) {
        plane_ = plane;
        columns_ = between(rays_.columns().offset(plane));
        rows_ = between(rays_.rows().offset(plane));
        for (int n = 0; n < count_ + 3; ++n) {
            read_[static_cast<std::size_t>(n)] =
                read(first_ - rows_.whole - 2 + n, lines_.data() + static_cast<std::size_t>(n) * padded_);
        }
    }
    /// The first ray that is between two elements of a row, or beside one.
    [[nodiscard]] std::size_t first_ray() const { return static_cast<std::size_t>(columns_.whole); }

    /// Stretches at which a row of the band is looked at.
    [[nodiscard]] std::uint64_t bits(int row) const {
        // A ray at r lies between elements r - whole - 1 and r - whole.
        const int upper = first_ + row - rows_.whole - 1, plane = rays_.plane_of_grid(plane_);
        return near_.at(plane, upper - 1) | near_.at(plane, upper) | near_.at(plane, upper + 1) |
               near_.at(plane, upper + 2);
    }
    /// Calls visit(begin, end) for runs of rays behind first_ray(), whole vectors; they reach a little beyond the
    /// stretches and do not overlap.
    template <class Visit>
    HWY_INLINE void for_each_run_of_rays(std::uint64_t bits, const Visit& visit) const {
        const auto length = static_cast<std::size_t>(near_.length());
        std::size_t begin = 0, end = 0;
        for_each_run(bits, [&](int first, int past) {
            const std::size_t from = static_cast<std::size_t>(first) * length;
            const std::size_t next = from - std::min(from, around_run);
            if (next > end || end == 0) {
                if (end > 0) {
                    visit(begin, end);
                }
                begin = next;
            }
            const std::size_t to = std::min(static_cast<std::size_t>(past) * length + around_run, elements() + 1);
            end = begin + whole_vectors(to - begin);
        });
        if (end > 0) {
            visit(begin, end);
        }
    }

    /// Calls take(place among the rays behind first_ray(), absorption) for a run of a row of the band.
    template <class Take>
    HWY_INLINE void absorb(int row, std::size_t begin, std::size_t end, const Take& take) {
        const D d;
        const auto first = static_cast<std::size_t>(row);
        const std::array<const float*, 4> around{read_[first], read_[first + 1], read_[first + 2], read_[first + 3]};
        Cubic(1.0F - rows_.part).mix(around, begin, end + most_lanes, mixed_.data());
        const Cubic between_columns(1.0F - columns_.part);
        for (std::size_t n = begin; n < end; n += hn::Lanes(d)) {
            take(n, between_columns.along(mixed_.data() + n, boundless));
        }
    }

    /// Calls put(index of an element, how many, numbers) for runs of elements of the plane's rows that lie between the
    /// rows in the middle of the band. numbers(row): transmittance at the rays; null: 1 at all, which is not put.
    template <class Numbers, class Put>
    HWY_INLINE void put_rows(const Numbers& numbers, const Put& put) {
        const D d;
        const Cubic between_rows(rows_.part), between_columns(columns_.part);
        const auto length = static_cast<std::size_t>(near_.length());
        for (int row = std::max(0, first_ + 1 - rows_.whole); row < rays_.rows().elements; ++row) {
            const int front = row + rows_.whole - first_;
            if (front + 2 >= count_) {
                break;
            }
            const std::uint64_t bits = near_.at(rays_.plane_of_grid(plane_), row);
            std::array<const float*, 4> around{};
            bool any = false;
            for (int n = 0; n < 4 && bits != 0; ++n) {
                const float* from = numbers(front - 1 + n);
                any = any || from != nullptr;
                if (from == nullptr && ones_.empty()) {
                    ones_.assign(width_, 1.0F);
                }
                around[static_cast<std::size_t>(n)] = (from != nullptr ? from : ones_.data()) + first_ray() - 1;
            }
            if (!any) {
                continue;
            }
            const std::size_t start = rays_.start(plane_, row);
            for_each_run(bits, [&](int first, int past) {
                const std::size_t begin = static_cast<std::size_t>(first) * length;
                const std::size_t end = std::min(static_cast<std::size_t>(past) * length, elements());
                const std::size_t most = begin + whole_vectors(end - begin);
                between_rows.mix(around, begin, most + most_lanes, line_.data());
                for (std::size_t n = begin; n < most; n += hn::Lanes(d)) {
                    hn::StoreU(between_columns.along(line_.data() + n, 1.0F), d, mixed_.data() + n);
                }
                put(start + begin * stride(), end - begin, mixed_.data() + begin);
            });
        }
    }

  private:
    /// A row of elements, with two zeros before and behind them. Zeros where it is not looked at.
    const float* read(int row, float* to) const {
        const std::uint64_t bits = near_.at(rays_.plane_of_grid(plane_), row);
        if (bits == 0) {
            return zeros_.data();
        }
        const float* from = grid_.values.data() + rays_.start(plane_, row);
        const auto length = static_cast<std::size_t>(near_.length());
        std::size_t done = 0;
        for_each_run(bits, [&](int first, int past) {
            const std::size_t begin = static_cast<std::size_t>(first) * length;
            const std::size_t end = std::min(static_cast<std::size_t>(past) * length, elements());
            std::fill(to + 2 + done, to + 2 + begin, 0.0F);
            if (stride() == 1) {
                std::copy(from + begin, from + end, to + 2 + begin);
            } else {
                for (std::size_t n = begin; n < end; ++n) {
                    to[n + 2] = from[n * stride()];
                }
            }
            done = end;
        });
        std::fill(to + 2 + done, to + 2 + elements(), 0.0F);
        return to;
    }

    const LightVolume& grid_;
    const Rays& rays_;
    const Stretches& near_;
    int first_, count_;
    std::size_t width_, padded_;
    std::vector<float> lines_, zeros_, ones_, mixed_, line_;
    std::array<const float*, band_rows + 3> read_{};
    int plane_ = 0;
    Between columns_, rows_;
};

/// Light along one band of rays. left: of ones.
void follow(Band band, const Rays& rays, LightVolume& left) {
    const D d;
    const std::size_t width = band.width(), rows = static_cast<std::size_t>(band.rows());
    // Absorbed before the plane; what is left at it; absorption at the plane before.
    std::vector<float> absorbed(rows * width, 0.0F), here(rows * width, 1.0F), before(rows * width, 0.0F);
    // Rows that nothing has dimmed yet.
    std::vector<unsigned char> clear(rows, 1);
    // The sum over points a slice distance apart is the one over planes, with Euler and Maclaurin's terms at its
    // beginning: of the absorption there, and of its slope towards the light.
    const float each = rays.slices(), at_beginning = (each * each - 1.0F) / (12.0F * each);
    const V of_plane = hn::Set(d, each), slope = hn::Set(d, at_beginning), zero = hn::Zero(d);
    const V own = hn::Set(d, 0.5F * (each - 1.0F) - at_beginning);
    const std::size_t stride = band.stride();
    for (int plane = 0; plane < rays.planes(); ++plane) {
        band.enter(plane);
        for (std::size_t row = 0; row < rows; ++row) {
            const std::uint64_t bits = band.bits(static_cast<int>(row));
            const std::size_t start = row * width + band.first_ray();
            float* sum = absorbed.data() + start;
            float* out = here.data() + start;
            float* last = before.data() + start;
            V any = zero;
            band.for_each_run_of_rays(bits, [&](std::size_t begin, std::size_t end) {
                band.absorb(static_cast<int>(row), begin, end, [&](std::size_t n, V taken) {
                    any = hn::Max(any, taken);
                    const V so_far = hn::LoadU(d, sum + n);
                    const V to_here = hn::MulAdd(own, taken, hn::MulAdd(slope, hn::LoadU(d, last + n), so_far));
                    hn::StoreU(left_of(d, hn::Max(to_here, zero)), d, out + n);
                    hn::StoreU(hn::MulAdd(of_plane, taken, so_far), d, sum + n);
                    hn::StoreU(taken, d, last + n);
                });
            });
            if (!hn::AllTrue(d, hn::Eq(any, zero))) {
                clear[row] = 0;
            }
        }
        band.put_rows(
            [&](int row) {
                const auto number = static_cast<std::size_t>(row);
                return clear[number] != 0 ? nullptr : here.data() + number * width;
            },
            [&](std::size_t start, std::size_t count, const float* numbers) {
                float* to = left.values.data() + start;
                for (std::size_t n = 0; n < count; ++n) {
                    to[n * stride] = numbers[n];
                }
            });
    }
}

/// Adds share times what is missing of light through the first `steps` slice distances along one band of rays.
void look_around(Band band, const Rays& rays, double steps, float share, LightVolume& open) {
    const D d;
    const std::size_t width = band.width(), rows = static_cast<std::size_t>(band.rows());
    const float each = rays.slices(), near = std::min(0.5F / each, 1.0F);
    // Beyond the last plane there is nothing, however far is looked.
    const Between far = between(std::min((steps + 0.5) / static_cast<double>(each), rays.planes() + 1.0));
    // Absorbed before each of the last planes, with half of the plane's own.
    const int ring = std::min(far.whole + 2, rays.planes() + 1);
    const std::size_t sheet = rows * width;
    std::vector<float> sums(static_cast<std::size_t>(ring) * sheet, 0.0F), before(sheet, 0.0F), here(sheet, 1.0F);
    const std::vector<float> nothing(width, 0.0F);
    std::vector<int> idle(rows, ring + 1); ///< planes since a row was looked at
    const std::size_t stride = band.stride();
    const V half_plane = hn::Set(d, 0.5F * each), beginning = hn::Set(d, each * near);
    const V half_near = hn::Set(d, 0.5F * near), part = hn::Set(d, far.part), zero = hn::Zero(d);
    for (int plane = 0; plane < rays.planes(); ++plane) {
        band.enter(plane);
        // Planes before the first one hold nothing.
        const auto at = [&](int number, std::size_t row) -> float* {
            return sums.data() + static_cast<std::size_t>((number + ring) % ring) * sheet + row * width;
        };
        for (std::size_t row = 0; row < rows; ++row) {
            const std::uint64_t bits = band.bits(static_cast<int>(row));
            float* sum = at(plane, row);
            const float* last = plane > 0 ? at(plane - 1, row) : nothing.data();
            idle[row] = bits != 0 ? 0 : idle[row] + 1;
            if (idle[row] > ring) {
                continue;
            }
            const std::size_t first = band.first_ray();
            const float* far_near = (plane < far.whole ? nothing.data() : at(plane - far.whole, row)) + first;
            const float* far_off = (plane < far.whole + 1 ? nothing.data() : at(plane - far.whole - 1, row)) + first;
            float* previous = before.data() + row * width + first;
            float* out = here.data() + row * width + first;
            const bool itself = far.whole == 0;
            std::size_t done = 0;
            band.for_each_run_of_rays(bits, [&](std::size_t begin, std::size_t end) {
                std::copy(last + done, last + first + begin, sum + done);
                done = first + end;
                band.absorb(static_cast<int>(row), begin, end, [&](std::size_t n, V taken) {
                    const V formerly = hn::LoadU(d, previous + n);
                    const V total = hn::MulAdd(half_plane, hn::Add(formerly, taken), hn::LoadU(d, last + first + n));
                    // The integral of what is linear from plane to plane over the first half of a slice distance.
                    const V closest = hn::Mul(beginning, hn::NegMulAdd(half_near, hn::Sub(taken, formerly), taken));
                    const V from = itself ? total : hn::LoadU(d, far_near + n);
                    const V beyond = hn::MulAdd(part, hn::Sub(hn::LoadU(d, far_off + n), from), from);
                    const V absorbed = hn::Sub(hn::Sub(total, closest), beyond);
                    hn::StoreU(left_of(d, hn::Max(absorbed, zero)), d, out + n);
                    hn::StoreU(total, d, sum + first + n);
                    hn::StoreU(taken, d, previous + n);
                });
            });
            std::copy(last + done, last + width, sum + done);
        }
        band.put_rows([&](int row) { return here.data() + static_cast<std::size_t>(row) * width; },
                      [&](std::size_t start, std::size_t count, const float* numbers) {
                          float* to = open.values.data() + start;
                          for (std::size_t n = 0; n < count; ++n) {
                              to[n * stride] += share * (numbers[n] - 1.0F);
                          }
                      });
    }
}

/// Planes first to past - 1 of sharpen(). borders: the planes before and behind them as they were.
void sharpen_planes(LightVolume& volume, const Stretches& near, int first, int past, const float* borders) {
    const D d;
    const V twelfth = hn::Set(d, 1.0F / 12.0F), six = hn::Set(d, 6.0F), zero = hn::Zero(d), one = hn::Set(d, 1.0F);
    const int height = volume.counts[1];
    const std::size_t plane = volume.index(0, 0, 1), row = volume.index(0, 1, 0), room = row + most_lanes;
    const auto length = static_cast<std::size_t>(near.length());
    std::vector<float> before(borders, borders + plane), above(room), own(room);
    before.resize(plane + most_lanes);
    for (int z = first; z < past; ++z) {
        float* middle = volume.values.data() + static_cast<std::size_t>(z) * plane;
        const float* behind = z + 1 == past ? borders + plane : middle + plane;
        std::copy(middle, middle + row, above.begin());
        for (int y = 0; y < height; ++y) {
            float* out = middle + static_cast<std::size_t>(y) * row;
            const float* below = y + 1 < height ? out + row : out;
            float* front = before.data() + static_cast<std::size_t>(y) * row;
            const float* back = behind + static_cast<std::size_t>(y) * row;
            std::copy(out, out + row, own.begin());
            for_each_run(near.at(z, y), [&](int first_stretch, int past_stretch) {
                const std::size_t begin = static_cast<std::size_t>(first_stretch) * length;
                const std::size_t end = std::min(static_cast<std::size_t>(past_stretch) * length, row);
                const auto alone = [&](std::size_t n) {
                    const float sides = own[n > 0 ? n - 1 : 0] + own[std::min(n + 1, row - 1)];
                    const float around = sides + above[n] + below[n] + front[n] + back[n];
                    return std::min(std::max(own[n] + (6.0F * own[n] - around) / 12.0F, 0.0F), 1.0F);
                };
                std::size_t n = begin;
                if (n == 0) {
                    out[n++] = alone(0);
                }
                // (The last element has no right neighbour.)
                for (; n + hn::Lanes(d) < std::min(end + 1, row); n += hn::Lanes(d)) {
                    const V here = hn::LoadU(d, own.data() + n);
                    const V sides = hn::Add(hn::LoadU(d, own.data() + n - 1), hn::LoadU(d, own.data() + n + 1));
                    const V ends = hn::Add(hn::LoadU(d, above.data() + n), hn::LoadU(d, below + n));
                    const V depths = hn::Add(hn::LoadU(d, front + n), hn::LoadU(d, back + n));
                    const V bent = hn::MulSub(six, here, hn::Add(hn::Add(sides, ends), depths));
                    hn::StoreU(hn::Min(hn::Max(hn::MulAdd(twelfth, bent, here), zero), one), d, out + n);
                }
                for (; n < end; ++n) {
                    out[n] = alone(n);
                }
            });
            std::copy(own.begin(), own.begin() + static_cast<std::ptrdiff_t>(row), front);
            std::swap(own, above);
        }
    }
}

void follow_band(const LightVolume& grid, const Rays& rays, const Stretches& near, std::size_t number,
                 LightVolume& left) {
    follow(Band(grid, rays, near, number), rays, left);
}
void look_around_band(const LightVolume& grid, const Rays& rays, const Stretches& near, std::size_t number,
                      double steps, float share, LightVolume& open) {
    look_around(Band(grid, rays, near, number), rays, steps, share, open);
}

/// What is compiled for each instruction set.
struct Loops {
    decltype(&follow_band) follow;
    decltype(&look_around_band) look_around;
    decltype(&sharpen_planes) sharpen;
};
Loops of_this_set() { return {&follow_band, &look_around_band, &sharpen_planes}; }

} // namespace sheetsplat::light_march::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace sheetsplat {

namespace light_march {

namespace {

struct Loops {
    void (*follow)(const LightVolume& grid, const Rays& rays, const Stretches& near, std::size_t number,
                   LightVolume& left);
    void (*look_around)(const LightVolume& grid, const Rays& rays, const Stretches& near, std::size_t number,
                        double steps, float share, LightVolume& open);
    void (*sharpen)(LightVolume& volume, const Stretches& near, int first, int past, const float* borders);

    template <class Own>
    static Loops of(const Own& own) {
        return {own.follow, own.look_around, own.sharpen};
    }
};

Loops chosen_loops() {
    switch (chosen_instruction_set()) {
#if HWY_TARGETS & HWY_SSE4
    case InstructionSet::sse4:
        return Loops::of(N_SSE4::of_this_set());
#endif
#if HWY_TARGETS & HWY_AVX2
    case InstructionSet::avx2:
        return Loops::of(N_AVX2::of_this_set());
#endif
#if HWY_TARGETS & HWY_AVX3
    case InstructionSet::avx512:
        return Loops::of(N_AVX3::of_this_set());
#endif
#if HWY_TARGETS & HWY_NEON
    case InstructionSet::neon:
        return Loops::of(N_NEON::of_this_set());
#endif
    default:
        return Loops::of(HWY_STATIC_DISPATCH(of_this_set)());
    }
}

} // namespace

} // namespace light_march

namespace {

using light_march::chosen_loops;
using light_march::Loops;
using light_march::Rays;
using light_march::Stretches;

LightVolume of_ones(const LightVolume& grid) {
    return {grid.origin, grid.per_step, grid.counts, std::vector<float>(grid.values.size(), 1.0F)};
}

/// Moves elements so that numbers interpolated linearly between them, which lie above a curve that is hollow and below
/// one that is not, are nearest to those that the elements had: less a twelfth of the second differences.
void sharpen(LightVolume& volume, const Stretches& near, const Loops& loops, ThreadPool& pool,
             const std::function<void()>& poll) {
    constexpr int slab = 16;
    const int depth = volume.counts[2];
    const std::size_t plane = volume.index(0, 0, 1);
    const int slabs = (depth + slab - 1) / slab;
    // The planes before and behind each slab, as they were.
    std::vector<float> borders(2 * static_cast<std::size_t>(slabs) * plane);
    const auto keep = [&](int number, std::size_t place) {
        const float* from = volume.values.data() + static_cast<std::size_t>(std::clamp(number, 0, depth - 1)) * plane;
        std::copy(from, from + plane, borders.data() + place * plane);
    };
    for (int n = 0; n < slabs; ++n) {
        keep(n * slab - 1, 2 * static_cast<std::size_t>(n));
        keep((n + 1) * slab, 2 * static_cast<std::size_t>(n) + 1);
    }
    pool.run(
        static_cast<std::size_t>(slabs),
        [&](std::size_t task, int) {
            const int first = static_cast<int>(task) * slab;
            loops.sharpen(volume, near, first, std::min(first + slab, depth), borders.data() + 2 * task * plane);
        },
        poll);
}

} // namespace

namespace {

void halve_row(const float* from, std::size_t many, float* to, std::size_t fewer) {
    to[0] = many > 1 ? 0.5F * from[0] + 0.25F * from[1] : 0.5F * from[0];
    std::size_t n = 1;
    for (; 2 * n + 1 < many; ++n) {
        to[n] = 0.25F * from[2 * n - 1] + 0.5F * from[2 * n] + 0.25F * from[2 * n + 1];
    }
    for (; n < fewer; ++n) {
        to[n] = 0.25F * from[2 * n - 1] + (2 * n < many ? 0.5F * from[2 * n] : 0.0F);
    }
}

} // namespace

LightVolume halved(const LightVolume& volume) {
    LightVolume half{volume.origin, volume.per_step, volume.counts, volume.values};
    for (std::size_t axis = 0; axis < 3; ++axis) {
        const LightVolume from = std::move(half);
        half = {from.origin, from.per_step, from.counts, {}};
        half.counts[axis] = from.counts[axis] / 2 + 1;
        half.per_step[axis] *= 0.5;
        half.values.resize(half.index(0, 0, half.counts[2]));
        const std::size_t inner = axis == 0 ? 1 : axis == 1 ? from.index(0, 1, 0) : from.index(0, 0, 1);
        const auto many = static_cast<std::size_t>(from.counts[axis]);
        const auto fewer = static_cast<std::size_t>(half.counts[axis]);
        const std::size_t outer = from.values.size() / (inner * many);
        for (std::size_t block = 0; block < outer; ++block) {
            if (inner == 1) {
                halve_row(from.values.data() + block * many, many, half.values.data() + block * fewer, fewer);
                continue;
            }
            for (std::size_t n = 0; n < fewer; ++n) {
                float* to = half.values.data() + (block * fewer + n) * inner;
                for (std::size_t neighbour = 0; neighbour < 3; ++neighbour) {
                    const std::size_t place = 2 * n + neighbour;
                    if (place < 1 || place > many) {
                        continue;
                    }
                    const float* values = from.values.data() + (block * many + place - 1) * inner;
                    const float weight = neighbour == 1 ? 0.5F : 0.25F;
                    for (std::size_t element = 0; element < inner; ++element) {
                        to[element] += weight * values[element];
                    }
                }
            }
        }
    }
    return half;
}

FollowedGrid::FollowedGrid(const LightVolume& absorption, WhereLight where) : absorption_(absorption), where_(where) {}

FollowedGrid::~FollowedGrid() = default;

const Stretches& FollowedGrid::stretches(std::size_t along) const {
    std::unique_ptr<const Stretches>& own = stretches_[along];
    if (!own) {
        own = std::make_unique<const Stretches>(absorption_, along, where_ == WhereLight::everywhere);
    }
    return *own;
}

LightVolume transmittance(const FollowedGrid& grid, const Vec3& towards_light, double slice_spacing, ThreadPool& pool,
                          const std::function<void()>& poll) {
    const Loops loops = chosen_loops();
    const LightVolume& absorption = grid.absorption();
    const Rays rays(absorption, towards_light, slice_spacing);
    const Stretches& near = grid.stretches(rays.along());
    LightVolume left = of_ones(absorption);
    pool.run(
        rays.bands(), [&](std::size_t number, int) { loops.follow(absorption, rays, near, number, left); }, poll);
    sharpen(left, grid.stretches(2), loops, pool, poll);
    return left;
}

LightVolume openness(const FollowedGrid& grid, const std::vector<Vec3>& directions, double steps, double slice_spacing,
                     ThreadPool& pool, const std::function<void()>& poll) {
    const Loops loops = chosen_loops();
    const LightVolume& absorption = grid.absorption();
    LightVolume open = of_ones(absorption);
    const float share = 1.0F / static_cast<float>(directions.size());
    for (const Vec3& direction : directions) {
        const Rays rays(absorption, direction, slice_spacing);
        const Stretches& near = grid.stretches(rays.along());
        pool.run(
            rays.bands(),
            [&](std::size_t number, int) { loops.look_around(absorption, rays, near, number, steps, share, open); },
            poll);
    }
    return open;
}

} // namespace sheetsplat

#endif
