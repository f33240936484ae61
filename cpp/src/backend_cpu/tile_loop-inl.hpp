// One tile, front to back: kernels are added to the sheets of the slices that they meet, finished slices are divided by
// their weights, classified, shaded and composited. Source: [NM05] figure 5, with a ring of sheets in the cache in
// place of sheet and copy buffers.

#if defined(SHEETSPLAT_CPU_TILE_LOOP_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_TILE_LOOP_INL
#undef SHEETSPLAT_CPU_TILE_LOOP_INL
#else
#define SHEETSPLAT_CPU_TILE_LOOP_INL
#endif

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"
#include "label_rests-inl.hpp"
#include "live-inl.hpp"
#include "reach-inl.hpp"
#include "resolve-inl.hpp"
#include "shade-inl.hpp"
#include "sheet_ring-inl.hpp"
#include "splat-inl.hpp"
#include "sum_rows-inl.hpp"
#include "tile_part-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
class TileLoop {
  public:
    TileLoop(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch)
        : setup_(setup), shape_(shape), scratch_(scratch), ring_(scratch.ring.data(), setup, shape), live_(shape),
          reach_(setup.groups.front().reach, shape, scratch) {
        if (setup.sums_slices && !setup.shading->kept.empty()) {
            kept_.emplace(*setup.shading, shape, setup.slices, scratch);
        }
        for (std::size_t set = 0; set < setup.label_sets.size(); ++set) {
            if (setup.label_sets[set].whole) {
                rests_.emplace_back(setup, set, ring_, shape);
            }
        }
        parts_.reserve(scratch.kernels.size());
        for (std::size_t number = 0; number < scratch.kernels.size(); ++number) {
            TilePart<T>& part = parts_.emplace_back(setup.parts[number], scratch.kernels[number]);
            all_summed_ = number < scratch.lattices.size() && start(part, scratch.lattices[number]) && all_summed_;
        }
    }

    void run(const std::function<bool()>& between) {
        if (setup_.counts_by_place && setup_.sums_slices && all_summed_) {
            if (kept_) {
                kept_->count(shape_, scratch_.planes.counted);
                return;
            }
            count_reached(setup_.groups.front().reach, shape_, setup_.slices, scratch_.planes.counted);
            return;
        }
        std::int64_t n = next_start();
        if (setup_.counts_by_place) {
            // Each slice may count.
            n = 0;
            last_touched_ = setup_.slices - 1;
        }
        if (n == none) {
            return; // (What is recorded there is 0 from the start.)
        }
        const std::int64_t lag = setup_.intervals ? 2 : 1;
        while (true) {
            if (!splat(n, between)) {
                break;
            }
            if (ring_.find(n) != nullptr) {
                divide(setup_, ring_, shape_, n, compared_);
            }
            for (LabelRests<T>& rest : rests_) {
                rest.compare(n, live_);
            }
            const int alive = scratch_.planes.alive;
            shade(n - lag);
            if (setup_.stops && scratch_.planes.last_kept != nullptr) {
                end_at_limit(setup_.shading->stop, shape_, scratch_.planes, ended_, n - lag);
                ended_ = n - lag;
            }
            if (setup_.stops && scratch_.planes.alive != alive) {
                shrink(live_, setup_.shading->stop, shape_, scratch_, n - lag, ++changes_ % 2 == 0);
            }
            ring_.release(n - lag - 1);
            if (!between() || (setup_.stops && scratch_.planes.alive == 0)) {
                break;
            }
            ++n;
            if (n > last_touched_ + lag) {
                // Nothing is on its way: on to the next slice that something reaches.
                for (std::int64_t old = n - lag - 2; old < n; ++old) {
                    ring_.release(old);
                }
                std::for_each(rests_.begin(), rests_.end(), [](LabelRests<T>& rest) { rest.forget(); });
                n = next_start();
                if (n == none) {
                    break;
                }
            }
        }
        if (records(SliceRecord::Of::absorption)) {
            record_before(setup_.record->planes * setup_.record->every);
        }
        // What is left in the ring would be found by the next tile.
        ring_.release_all();
    }

  private:
    static constexpr std::int64_t none = TilePart<T>::none;

    /// Begins with a lattice; where no slice is looked at by itself, adds all of it to the picture if that can be, and
    /// returns true.
    bool start(TilePart<T>& part, const LatticeRows& rows) {
        RowFeed<T>& feed = part.set_feed(rows, shape_);
        const RowShape<T>& shape = part.kernels().shapes.front();
        if (!setup_.sums_slices || part.profile().weight_channel >= 0 || !sums_fit(shape)) {
            feed.begin();
            return false;
        }
        scratch_.sections_drawn += sum_lattice(setup_, part.profile(), shape, feed, kept_ ? &*kept_ : nullptr, shape_,
                                               scratch_, scratch_.planes.scalar);
        return true;
    }

    /// The next slice that a kernel begins on.
    [[nodiscard]] std::int64_t next_start() {
        std::int64_t next = none;
        for (TilePart<T>& part : parts_) {
            next = std::min(next, part.next_start(live_));
        }
        return next;
    }

    /// Adds what starts at slice n, or is drawn again from there on; false where `between` said so.
    bool splat(std::int64_t n, const std::function<bool()>& between) {
        return std::all_of(parts_.begin(), parts_.end(), [&](TilePart<T>& part) {
            if (!part.draws(n, live_)) {
                return true;
            }
            return setup_.slopes ? splat_part<true>(part, n, between) : splat_part<false>(part, n, between);
        });
    }
    /// slopes: derivatives too.
    template <bool slopes>
    bool splat_part(TilePart<T>& part, std::int64_t n, const std::function<bool()>& between) {
        const PartProfile<T>& profile = part.profile();
        Target<T> targets[covered_slices * (1 + most_beside)];
        for (int slice = 0; slice < covered_slices; ++slice) {
            const auto sheet = [&](int channel) { return channel >= 0 ? ring_.plane(n + slice, channel) : nullptr; };
            targets[slice] = {sheet(profile.value_channel),
                              sheet(profile.weight_channel),
                              sheet(profile.other_channel),
                              shape_.stride,
                              sheet(profile.slope_channel),
                              sheet(profile.weight_slope_channel),
                              ring_.elements()};
            Target<T>* beside = targets + slice;
            for (const auto& other : profile.beside) {
                beside += covered_slices;
                *beside = {sheet(other.value_channel), nullptr, nullptr, shape_.stride, nullptr, nullptr, 0};
            }
        }
        const auto splat_to = [&](std::size_t field) {
            return Splat<T, slopes>{setup_,
                                    profile,
                                    live_,
                                    static_cast<std::int32_t>(n),
                                    targets + field * covered_slices,
                                    part.waiting_for(n)};
        };
        static_assert(most_beside == 3);
        Splat<T, slopes> splats[1 + most_beside] = {splat_to(0), splat_to(1), splat_to(2), splat_to(3)};
        Splat<T, slopes>& splat = splats[0];
        // One slice can hold very many kernels. (Where the picture is given up, so are the sheets.)
        const bool all_drawn = part.draw(splat, shape_, [&](unsigned kernels, int sections) {
            scratch_.sections_drawn += static_cast<std::uint64_t>(sections);
            asked_ += kernels;
            return asked_ % splats_between_polls >= kernels || between();
        });
        const auto touch = [&](std::int32_t slice, const Rect& rect, std::size_t group) {
            ring_.touch(slice, rect, group);
            last_touched_ = std::max<std::int64_t>(last_touched_, slice);
        };
        splat.tell([&](std::int32_t slice, const Rect& rect) {
            touch(slice, rect, profile.group);
            if (profile.other_channel >= 0) {
                touch(slice, rect, profile.other_group);
            }
        });
        for (std::size_t other = 0; other < profile.beside.size(); ++other) {
            splats[1 + other].tell(
                [&](std::int32_t slice, const Rect& rect) { touch(slice, rect, profile.beside[other].group); });
        }
        if (!part.waiting_for(n).empty()) {
            last_touched_ = std::max<std::int64_t>(last_touched_, n + covered_slices);
        }
        return all_drawn;
    }

    [[nodiscard]] bool records(SliceRecord::Of what) const {
        return setup_.record != nullptr && setup_.record->of == what;
    }
    /// The tile's corner in a plane of the record.
    [[nodiscard]] float* in_record(std::int64_t plane) const {
        const SliceRecord& record = *setup_.record;
        return record.values + static_cast<std::size_t>(plane) * record.plane +
               static_cast<std::size_t>(shape_.y) * record.row + static_cast<std::size_t>(shape_.x);
    }

    /// Writes rho of slice n, where anything reaches, to its plane.
    void record_rho(std::int64_t n, const T* rho, const Rect& rect) {
        for (int y = rect.y0; y < rect.y1; ++y) {
            const T* from = rho + static_cast<std::size_t>(y + 1) * static_cast<std::size_t>(shape_.stride) + 1;
            float* out = in_record(n) + static_cast<std::size_t>(y) * setup_.record->row;
            std::transform(from + rect.x0, from + rect.x1, out + rect.x0,
                           [](T value) { return static_cast<float>(value); });
        }
    }

    /// Writes what light has lost to the planes that end before slice n, each of which begins at 0.
    void record_before(std::int64_t n) {
        const SliceRecord& record = *setup_.record;
        for (; recorded_ < record.planes && (recorded_ + 1) * record.every <= n; ++recorded_) {
            float* out = in_record(recorded_);
            T* sums = scratch_.planes.alpha;
            for (int y = 0; y < shape_.height; ++y, out += record.row, sums += shape_.stride) {
                std::transform(sums, sums + shape_.width, out, [](T sum) { return static_cast<float>(sum); });
                std::fill(sums, sums + shape_.width, T(0));
            }
        }
    }

    void shade(std::int64_t n) {
        if (records(SliceRecord::Of::absorption)) {
            record_before(n);
        }
        const auto* here = ring_.find(n);
        const auto* after = setup_.intervals ? ring_.find(n + 1) : nullptr;
        SlabWindow<T> window;
        window.n = n;
        Rect rect;
        if (setup_.counts_by_place) {
            // (Points that no kernel was drawn to count too.)
            window.weight[0] = n >= 0 && n < setup_.slices ? reach_.of(n) : nullptr;
            if (window.weight[0] != nullptr) {
                rect = Rect{0, 0, shape_.width + 2, shape_.height + 2};
            }
        } else {
            if (here != nullptr) {
                rect.add(here->touched);
            }
            if (after != nullptr) {
                rect.add(after->touched);
            }
        }
        window.rect = in_picture(rect);
        if (window.rect.empty()) {
            return;
        }
        find_sheets(0, n, window);
        for (std::size_t later = 0; later < later_.size(); ++later) {
            find_sheets(later + 1, n, later_[later]);
        }
        window.later_groups = later_.data();
        if (records(SliceRecord::Of::rho)) {
            const std::size_t group = setup_.record->group;
            record_rho(n, (group == 0 ? window : later_[group - 1]).rho[1], window.rect);
            return;
        }
        if (setup_.record != nullptr) {
            absorb_slab(*setup_.shading, shape_, window, scratch_.planes);
            return;
        }
        shade_slab(*setup_.shading, shape_, window, scratch_.planes);
    }

    /// Of pixels of the sheets, those of the tile.
    [[nodiscard]] Rect in_picture(const Rect& rect) const {
        return Rect{rect.x0 - 1, rect.y0 - 1, rect.x1 - 1, rect.y1 - 1}.cut_to({0, 0, shape_.width, shape_.height});
    }

    /// The sheets of a group around slice n.
    void find_sheets(std::size_t number, std::int64_t n, SheetWindow<T>& window) const {
        const GroupSheets<T>& group = setup_.groups[number];
        const auto sheet = [&](std::int64_t slice, int channel) -> const T* {
            return ring_.find(slice) != nullptr ? ring_.plane(slice, channel) : scratch_.zeros.data();
        };
        const auto set = std::find_if(setup_.label_sets.begin(), setup_.label_sets.end(), [&](const LabelSet& one) {
            return number >= one.groups.first && number < one.groups.last;
        });
        for (int around = 0; around < (setup_.intervals ? 4 : 3); ++around) {
            const std::int64_t slice = n - 1 + around;
            const bool absent = set != setup_.label_sets.end() && ring_.touched(slice, number).empty();
            window.rho[around] = sheet(slice, absent ? set->absent_channel : group.rho_channel);
        }
        if (!setup_.shading->groups[number].at_zero) {
            Rect touched = ring_.touched(n, number);
            touched.add(setup_.intervals ? ring_.touched(n + 1, number) : Rect());
            window.shown = in_picture(touched);
        }
        window.reach = setup_.shading->empty_test && !setup_.keep_weight ? &group.reach : nullptr;
        for (int ahead = 0; ahead < (setup_.intervals ? 2 : 1); ++ahead) {
            if (setup_.keep_weight) {
                window.weight[ahead] = sheet(n + ahead, group.weight_channel);
            }
            for (int axis = 0; axis < 3 && setup_.slopes; ++axis) {
                window.slope[ahead][axis] = sheet(n + ahead, group.slope_channel + axis);
            }
        }
    }

    const LoopSetup<T>& setup_;
    const TileShape& shape_;
    TileScratch<T>& scratch_;
    SheetRing<T> ring_;
    Live live_;
    ReachSheets<T> reach_;
    std::vector<TilePart<T>> parts_;      ///< lattices first
    std::optional<KeptOfPixels<T>> kept_; ///< where sums over slices are clipped
    bool all_summed_ = true;              ///< all parts are lattices that have been added to the picture
    std::vector<LabelRests<T>> rests_;    ///< of sets that have one
    std::vector<T*> compared_;            ///< sheets of labels
    std::vector<SheetWindow<T>> later_ = std::vector<SheetWindow<T>>(setup_.groups.size() - 1);
    unsigned asked_ = 0;
    unsigned changes_ = 0;
    std::int64_t last_touched_ = -1;
    std::int64_t ended_ = -3;   ///< slice up to which pixels at the depth limit are counted as finished
    std::int64_t recorded_ = 0; ///< planes
};

template <class T>
void run_tile(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch,
              const std::function<bool()>& between) {
    TileLoop<T>(setup, shape, scratch).run(between);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
