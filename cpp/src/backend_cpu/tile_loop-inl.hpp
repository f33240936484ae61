// One tile, front to back: kernels are added to the sheets of the slices that they meet, finished slices are divided by
// their weights, classified, shaded and composited. Source: [NM05] figure 5, with a ring of sheets in the cache in
// place of sheet and copy buffers.

#if defined(SHEETSPLAT_SIMD_TILE_LOOP_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_SIMD_TILE_LOOP_INL
#undef SHEETSPLAT_SIMD_TILE_LOOP_INL
#else
#define SHEETSPLAT_SIMD_TILE_LOOP_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "shade-inl.hpp"
#include "splat-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
class TileLoop {
  public:
    TileLoop(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch)
        : setup_(setup), shape_(shape), scratch_(scratch), elements_(shape.sheet_elements()), live_(shape) {}

    void run(const std::function<bool()>& between) {
        std::int64_t n = next_start();
        if (n == none) {
            return; // (What is recorded there is 0 from the start.)
        }
        const std::int64_t lag = setup_.intervals ? 2 : 1;
        while (true) {
            if (!splat(n, between)) {
                break;
            }
            if (Slot* slot = find(n)) {
                divide(*slot);
            }
            shade(n - lag);
            release(n - lag - 1);
            if (!between() || (setup_.stops && scratch_.planes.alive == 0)) {
                break;
            }
            ++n;
            if (n > last_touched_ + lag) {
                // Nothing is on its way: on to the next slice that something reaches.
                for (std::int64_t old = n - lag - 2; old < n; ++old) {
                    release(old);
                }
                n = next_start();
                if (n == none) {
                    break;
                }
            }
        }
        if (setup_.record != nullptr) {
            record_until((setup_.record->planes - 1) * setup_.record->every);
        }
        // What is left in the ring would be found by the next tile.
        for (Slot& slot : slots_) {
            clear(slot);
        }
        for (auto& again : scratch_.again) {
            again.clear();
        }
    }

  private:
    static constexpr std::int64_t none = std::numeric_limits<std::int64_t>::max();

    struct Slot {
        std::int64_t slice = -1; ///< -1: free
        Rect touched;            ///< pixels of the sheets
    };

    [[nodiscard]] static std::size_t index_of(std::int64_t n) { return static_cast<std::size_t>(n) % ring_slots; }

    [[nodiscard]] Slot* find(std::int64_t n) {
        if (n < 0) {
            return nullptr;
        }
        Slot& slot = slots_[index_of(n)];
        return slot.slice == n ? &slot : nullptr;
    }

    [[nodiscard]] T* plane(std::int64_t n, int channel) const {
        const std::size_t number =
            index_of(n) * static_cast<std::size_t>(setup_.channels) + static_cast<std::size_t>(channel);
        return scratch_.ring.data() + number * elements_;
    }

    [[nodiscard]] std::int64_t next_start() const {
        std::int64_t next = none;
        for (std::size_t part = 0; part < scratch_.kernels.size(); ++part) {
            const auto& sections = scratch_.kernels[part].sections;
            if (next_[part] < sections.size()) {
                next = std::min<std::int64_t>(next, sections[next_[part]].first);
            }
        }
        return next;
    }

    /// Adds what starts at slice n, or is drawn again from there on; false where `between` said so.
    bool splat(std::int64_t n, const std::function<bool()>& between) {
        return setup_.slope_channel >= 0 ? splat_with<true>(n, between) : splat_with<false>(n, between);
    }
    /// slopes: derivatives too.
    template <bool slopes>
    bool splat_with(std::int64_t n, const std::function<bool()>& between) {
        auto& again = scratch_.again[static_cast<std::size_t>(n) % covered_slices];
        // The list of this slice becomes that of slice n + covered_slices: what is drawn again is taken out first.
        const std::size_t waiting = again.size();
        for (std::size_t part = 0; part < scratch_.kernels.size(); ++part) {
            const PartProfile<T>& profile = setup_.parts[part];
            const TileKernels<T>& kernels = scratch_.kernels[part];
            if (!again_of(again, waiting, part) &&
                (next_[part] >= kernels.sections.size() || kernels.sections[next_[part]].first > n)) {
                continue;
            }
            Target<T> targets[covered_slices];
            for (int slice = 0; slice < covered_slices; ++slice) {
                const auto sheet = [&](int channel) { return channel >= 0 ? plane(n + slice, channel) : nullptr; };
                targets[slice] = {sheet(profile.value_channel), sheet(profile.weight_channel),       shape_.stride,
                                  sheet(profile.slope_channel), sheet(profile.weight_slope_channel), elements_};
            }
            Splatter<T, slopes> splatter(setup_, profile, live_, static_cast<std::int32_t>(n), targets);
            const bool shared_shape = kernels.shapes.size() == 1, shared_extra = kernels.extras.empty();
            const auto slices_left = [&](std::int64_t last) {
                return static_cast<int>(std::min<std::int64_t>(last + 1 - n, covered_slices));
            };
            const auto draw_again = [&](std::int64_t last, std::uint32_t number) {
                if (last >= n + covered_slices) {
                    again.push_back({static_cast<std::uint32_t>(part), number});
                    last_touched_ = std::max<std::int64_t>(last_touched_, n + covered_slices);
                }
            };
            const auto draw = [&](std::uint32_t number) {
                const Section<T>& section = kernels.sections[number];
                const RowShape<T>& row_shape = kernels.shapes[shared_shape ? 0 : number];
                SectionExtra<T> extra;
                if (shared_extra) {
                    extra.weight = kernels.weight;
                    extra.last = last_of(section, T(-1) / row_shape.ds, kernels.last_slice);
                } else {
                    extra = kernels.extras[number];
                }
                const int count = slices_left(extra.last);
                if (count > 0) {
                    drawn_ += static_cast<std::uint64_t>(splatter.draw(section, extra, row_shape, count));
                    draw_again(extra.last, number);
                }
            };
            // Kernels of a lattice in an orthographic view, most of which are of one shape and upright.
            const RowShape<T>& first_shape = kernels.shapes.front();
            const bool plain = shared_shape && shared_extra && !setup_.slab && !setup_.perspective &&
                               first_shape.Y1 == T(0) && first_shape.d1 == T(0) && first_shape.d2 == T(0);
            const T per_X = T(1) / first_shape.X, per_slice = T(-1) / first_shape.ds;
            const auto draw_plain = [&](auto with_weight, std::uint32_t number) {
                const Section<T>& section = kernels.sections[number];
                const std::int64_t last = last_of(section, per_slice, kernels.last_slice);
                const int count = slices_left(last);
                if (count > 0) {
                    drawn_ += static_cast<std::uint64_t>(splatter.template draw_upright<with_weight.value>(
                        section, kernels.weight, first_shape, per_X, count));
                    draw_again(last, number);
                }
            };
            // One slice can hold very many kernels. (Where the picture is given up, so are the sheets.)
            const auto given_up = [&] { return ++asked_ % between_questions == 0 && !between(); };
            for (std::size_t entry = 0; entry < waiting; ++entry) {
                if (again[entry].part == part) {
                    draw(again[entry].section);
                    if (given_up()) {
                        return false;
                    }
                }
            }
            std::size_t& next = next_[part];
            std::size_t past = next;
            while (past < kernels.sections.size() && kernels.sections[past].first <= n) {
                ++past;
            }
            if (plain && profile.weight_channel >= 0) {
                for (; next < past; ++next) {
                    draw_plain(std::true_type(), static_cast<std::uint32_t>(next));
                    if (given_up()) {
                        return false;
                    }
                }
            } else if (plain) {
                for (; next < past; ++next) {
                    draw_plain(std::false_type(), static_cast<std::uint32_t>(next));
                    if (given_up()) {
                        return false;
                    }
                }
            } else {
                for (; next < past; ++next) {
                    draw(static_cast<std::uint32_t>(next));
                    if (given_up()) {
                        return false;
                    }
                }
            }
            splatter.tell([&](std::int32_t slice, const Rect& rect) {
                Slot& slot = slots_[index_of(slice)];
                slot.slice = slice;
                slot.touched.add(rect);
                last_touched_ = std::max<std::int64_t>(last_touched_, slice);
            });
        }
        again.erase(again.begin(), again.begin() + static_cast<std::ptrdiff_t>(waiting));
        scratch_.sections_drawn += drawn_;
        drawn_ = 0;
        return true;
    }

    /// The last slice that a kernel meets; per_slice: slices from height 1 to 0.
    [[nodiscard]] static HWY_INLINE std::int32_t last_of(const Section<T>& section, T per_slice, std::int32_t most) {
        const T further = std::floor((T(1) + section.s) * per_slice);
        return static_cast<std::int32_t>(
            std::min(static_cast<T>(section.first) + std::max(further, T(-1)), static_cast<T>(most)));
    }

    using Again = typename TileScratch<T>::Again;
    [[nodiscard]] static bool again_of(const std::vector<Again>& again, std::size_t waiting, std::size_t part) {
        return std::any_of(again.begin(), again.begin() + static_cast<std::ptrdiff_t>(waiting),
                           [&](const Again& entry) { return entry.part == part; });
    }

    /// rho of a slice, in the place of the sums of the fields that share sheets; W of all in its own channel.
    void divide(const Slot& slot) {
        const hn::CappedTag<T, 16> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        if (!setup_.threshold && setup_.own.empty()) {
            return;
        }
        const Rect& rect = slot.touched;
        for (int y = rect.y0; y < rect.y1; ++y) {
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y) * shape_.stride;
            T* rho = plane(slot.slice, 0) + at;
            T* weight = setup_.weight_channel >= 0 ? plane(slot.slice, setup_.weight_channel) + at : nullptr;
            if (setup_.slope_channel >= 0) {
                divide_slopes(slot.slice, at, rect);
            }
            for (int x = rect.x0; x < rect.x1; x += lanes) {
                auto sum = hn::LoadU(d, rho + x);
                if (setup_.threshold) {
                    sum = hn::Div(sum, hn::Max(hn::Set(d, setup_.w0), hn::LoadU(d, weight + x)));
                }
                for (const OwnSheets<T>& own : setup_.own) {
                    const auto own_weight = hn::LoadU(d, plane(slot.slice, own.weight_channel) + at + x);
                    sum = hn::Add(sum, hn::Div(hn::LoadU(d, plane(slot.slice, own.value_channel) + at + x),
                                               hn::Max(hn::Set(d, own.w0), own_weight)));
                    if (setup_.keep_weight) {
                        hn::StoreU(hn::Add(hn::LoadU(d, weight + x), own_weight), d, weight + x);
                    }
                }
                hn::StoreU(sum, d, rho + x);
            }
        }
    }

    /// A row of the derivatives of rho, in the place of those of the sums of the fields that share sheets; while the
    /// sums themselves are still there.
    void divide_slopes(std::int64_t n, std::ptrdiff_t row, const Rect& rect) {
        const hn::CappedTag<T, 16> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        for (int x = rect.x0; x < rect.x1; x += lanes) {
            const std::ptrdiff_t at = row + x;
            const auto load = [&](int channel) { return hn::LoadU(d, plane(n, channel) + at); };
            // (D' W - D W') / W^2 where W > w0, else D' / w0.
            const auto quotient = [&](int value, int weight, int slope, int weight_slope, T w0) {
                const auto least = hn::Set(d, w0), w = load(weight);
                const auto per_divisor = hn::Div(hn::Set(d, T(1)), hn::Max(least, w));
                const auto rho = hn::IfThenElseZero(hn::Gt(w, least), hn::Mul(load(value), per_divisor));
                return hn::Mul(hn::NegMulAdd(rho, load(weight_slope), load(slope)), per_divisor);
            };
            for (int axis = 0; axis < 3; ++axis) {
                auto sum = setup_.threshold ? quotient(0, setup_.weight_channel, setup_.slope_channel + axis,
                                                       setup_.weight_slope_channel + axis, setup_.w0)
                                            : load(setup_.slope_channel + axis);
                for (const OwnSheets<T>& own : setup_.own) {
                    sum = hn::Add(sum, quotient(own.value_channel, own.weight_channel, own.slope_channel + axis,
                                                own.weight_slope_channel + axis, own.w0));
                }
                hn::StoreU(sum, d, plane(n, setup_.slope_channel + axis) + at);
            }
        }
    }

    /// Writes what light has lost so far to the planes up to slice n.
    void record_until(std::int64_t n) {
        const AbsorptionRecord& record = *setup_.record;
        for (; recorded_ < record.planes && recorded_ * record.every <= n; ++recorded_) {
            float* out = record.values + static_cast<std::size_t>(recorded_) * record.plane +
                         static_cast<std::size_t>(shape_.y) * record.row + static_cast<std::size_t>(shape_.x);
            const T* sums = scratch_.planes.alpha;
            for (int y = 0; y < shape_.height; ++y, out += record.row, sums += shape_.stride) {
                std::transform(sums, sums + shape_.width, out, [](T sum) { return static_cast<float>(sum); });
            }
        }
    }

    void shade(std::int64_t n) {
        if (setup_.record != nullptr) {
            record_until(n);
        }
        const Slot* here = find(n);
        const Slot* after = setup_.intervals ? find(n + 1) : nullptr;
        if (here == nullptr && after == nullptr) {
            return;
        }
        SlabWindow<T> window;
        window.n = n;
        Rect rect;
        if (here != nullptr) {
            rect.add(here->touched);
        }
        if (after != nullptr) {
            rect.add(after->touched);
        }
        window.rect = Rect{std::max(rect.x0 - 1, 0), std::max(rect.y0 - 1, 0), std::min(rect.x1 - 1, shape_.width),
                           std::min(rect.y1 - 1, shape_.height)};
        if (window.rect.empty()) {
            return;
        }
        for (int around = 0; around < (setup_.intervals ? 4 : 3); ++around) {
            const std::int64_t slice = n - 1 + around;
            window.rho[around] = find(slice) != nullptr ? plane(slice, 0) : scratch_.zeros.data();
        }
        if (setup_.keep_weight) {
            window.weight[0] = here != nullptr ? plane(n, setup_.weight_channel) : scratch_.zeros.data();
            window.weight[1] = after != nullptr ? plane(n + 1, setup_.weight_channel) : scratch_.zeros.data();
        }
        if (setup_.slope_channel >= 0) {
            for (int axis = 0; axis < 3; ++axis) {
                const int channel = setup_.slope_channel + axis;
                window.slope[0][axis] = here != nullptr ? plane(n, channel) : scratch_.zeros.data();
                window.slope[1][axis] = after != nullptr ? plane(n + 1, channel) : scratch_.zeros.data();
            }
        }
        if (setup_.record != nullptr) {
            absorb_slab(*setup_.shading, shape_, window, scratch_.planes);
            return;
        }
        const int alive = scratch_.planes.alive;
        shade_slab(*setup_.shading, shape_, window, scratch_.planes);
        if (setup_.stops && scratch_.planes.alive != alive) {
            shrink();
        }
    }

    /// What of the sheets some pixel still looks at, for itself or for its gradient.
    void shrink() {
        const int* rows = scratch_.planes.row_alive;
        int first = 0, past = shape_.height;
        while (first < past && rows[first] == 0) {
            ++first;
        }
        while (past > first && rows[past - 1] == 0) {
            --past;
        }
        live_.rect.y0 = first;
        live_.rect.y1 = past + 2;
        if (shape_.width + 2 > Live::blocks * Live::block_edge || ++changes_ % 4 != 0) {
            return;
        }
        // One bit a pixel that is alive, with its neighbours; then one a block.
        const hn::CappedTag<T, 16> d;
        const int lanes = static_cast<int>(hn::Lanes(d));
        const auto stop = hn::Set(d, setup_.shading->stop);
        std::vector<std::uint64_t>& bits = scratch_.alive_rows;
        bits.assign(static_cast<std::size_t>(shape_.height) + 2, 0);
        const std::uint64_t inside = (std::uint64_t{1} << shape_.width) - 1;
        for (int y = first; y < past; ++y) {
            if (rows[y] == 0) {
                continue;
            }
            std::uint64_t row = 0;
            for (int x = 0; x < shape_.width; x += lanes) {
                const auto alive = hn::Lt(
                    hn::LoadU(d, scratch_.planes.alpha + static_cast<std::ptrdiff_t>(y) * shape_.stride + x), stop);
                std::uint8_t packed[8] = {};
                hn::StoreMaskBits(d, alive, packed);
                std::uint64_t word = 0;
                std::memcpy(&word, packed, sizeof word);
                row |= word << x;
            }
            row &= inside;
            // Pixel x of the picture is column x + 1 of the sheets.
            const std::uint64_t spread = row | row << 1 | row << 2;
            for (int around = 0; around < 3; ++around) {
                bits[static_cast<std::size_t>(y + around)] |= spread;
            }
        }
        live_.set(bits);
    }

    void release(std::int64_t n) {
        if (Slot* slot = find(n)) {
            clear(*slot);
        }
    }

    void clear(Slot& slot) {
        if (slot.slice < 0) {
            return;
        }
        // Vectors run over both ends of what was touched, and rounding may have left something there.
        const int first = slot.touched.x0 & ~(TileShape::padding - 1);
        const int past = std::min(slot.touched.x1 + TileShape::padding, shape_.stride);
        for (int channel = 0; channel < setup_.channels; ++channel) {
            T* sheet = plane(slot.slice, channel);
            for (int y = slot.touched.y0; y < slot.touched.y1; ++y) {
                T* row = sheet + static_cast<std::ptrdiff_t>(y) * shape_.stride;
                std::fill(row + first, row + past, T(0));
            }
        }
        slot = Slot{};
    }

    const LoopSetup<T>& setup_;
    const TileShape& shape_;
    TileScratch<T>& scratch_;
    std::size_t elements_;
    Live live_;
    /// Kernels from one look at whether to go on to the next: some milliseconds of the largest.
    static constexpr unsigned between_questions = 512;
    unsigned asked_ = 0;
    unsigned changes_ = 0;
    Slot slots_[ring_slots];
    std::vector<std::size_t> next_ = std::vector<std::size_t>(scratch_.kernels.size(), 0);
    std::int64_t last_touched_ = -1;
    std::int64_t recorded_ = 0; ///< planes
    std::uint64_t drawn_ = 0;
};

template <class T>
void run_tile(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch,
              const std::function<bool()>& between) {
    TileLoop<T>(setup, shape, scratch).run(between);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
