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
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "feed_rows-inl.hpp"
#include "hwy/highway.h"
#include "live-inl.hpp"
#include "reach-inl.hpp"
#include "resolve-inl.hpp"
#include "shade-inl.hpp"
#include "sheet_ring-inl.hpp"
#include "splat-inl.hpp"
#include "sum_rows-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
class TileLoop {
  public:
    TileLoop(const LoopSetup<T>& setup, const TileShape& shape, TileScratch<T>& scratch)
        : setup_(setup), shape_(shape), scratch_(scratch), ring_(scratch.ring.data(), setup.channels, shape),
          live_(shape), reach_(setup.groups.front().reach, shape, scratch) {
        feeds_.reserve(scratch.lattices.size());
        if (setup.sums_slices && !setup.shading->kept.empty()) {
            kept_.emplace(*setup.shading, shape, setup.slices, scratch);
        }
        for (std::size_t part = 0; part < scratch.lattices.size(); ++part) {
            feeds_.emplace_back(scratch.lattices[part], shape, scratch.kernels[part]);
            if (setup.sums_slices && setup.parts[part].weight_channel < 0 &&
                sums_fit(scratch.kernels[part].shapes.front())) {
                sum(part);
            } else {
                all_summed_ = false;
                feeds_.back().begin();
            }
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
            if (const auto* slot = ring_.find(n)) {
                divide(setup_, ring_, shape_, n, slot->touched);
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
        for (auto& again : scratch_.again) {
            again.clear();
        }
    }

  private:
    static constexpr std::int64_t none = std::numeric_limits<std::int64_t>::max();

    /// The next slice that a kernel begins on.
    [[nodiscard]] std::int64_t next_start() {
        std::int64_t next = none;
        for (std::size_t part = 0; part < scratch_.kernels.size(); ++part) {
            while (next_[part] >= scratch_.kernels[part].sections.size() && feeds(part)) {
                feed(part);
            }
            const auto& sections = scratch_.kernels[part].sections;
            if (next_[part] < sections.size()) {
                next = std::min<std::int64_t>(next, sections[next_[part]].first);
            }
        }
        return next;
    }

    /// Whether the part is a lattice that is not fed to its end.
    [[nodiscard]] bool feeds(std::size_t part) const { return part < feeds_.size() && !feeds_[part].ended(); }

    /// Adds the kernels of a lattice to the picture.
    void sum(std::size_t part) {
        RowFeed<T>& feed = feeds_[part];
        RowSums<T> sums(setup_.parts[part], scratch_.kernels[part].shapes.front(),
                        scratch_.lattices[part].view->value_scale, scratch_.lattices[part].view->field->counted_from(),
                        shape_, setup_.shading->scalar_step, scratch_, scratch_.planes.scalar);
        const Vec3 step = feed.step_of_places();
        const auto cuts = feed.row_cuts(setup_.shading->kept);
        feed.for_each_stretch([&](const auto* values, const Vec3& eye, std::uint32_t count) {
            const Vec3 place = feed.place_of(eye);
            if (!kept_) {
                sums.add(values, place, step, count);
                return;
            }
            const auto [begin, end] = feed.wholly_kept(cuts, eye, count);
            if (begin == 0 && end == count) {
                sums.add(values, place, step, count);
                return;
            }
            const auto from = [&](std::uint32_t i) { return place + static_cast<double>(i) * step; };
            sums.add_cut(*kept_, values, place, step, begin);
            sums.add(values + begin, from(begin), step, end - begin);
            sums.add_cut(*kept_, values + end, from(end), step, count - end);
        });
        sums.flush();
        scratch_.sections_drawn += sums.sections();
    }

    /// Replaces the kernels of a lattice, all of which are drawn, by those of the next slices.
    void feed(std::size_t part) {
        TileKernels<T>& kernels = scratch_.kernels[part];
        auto& carried = scratch_.carried;
        carried.clear();
        for (auto& again : scratch_.again) {
            for (Again& entry : again) {
                if (entry.part == part) {
                    carried.push_back(kernels.sections[entry.section]);
                    entry.section = static_cast<std::uint32_t>(carried.size() - 1);
                }
            }
        }
        kernels.sections.assign(carried.begin(), carried.end());
        next_[part] = carried.size();
        feeds_[part].feed(live_);
    }

    /// Adds what starts at slice n, or is drawn again from there on; false where `between` said so.
    bool splat(std::int64_t n, const std::function<bool()>& between) {
        return setup_.slopes ? splat_with<true>(n, between) : splat_with<false>(n, between);
    }
    /// slopes: derivatives too.
    template <bool slopes>
    bool splat_with(std::int64_t n, const std::function<bool()>& between) {
        auto& again = scratch_.again[static_cast<std::size_t>(n) % covered_slices];
        // The list of this slice becomes that of slice n + covered_slices: what is drawn again is taken out first.
        const std::size_t waiting = again.size();
        for (std::size_t part = 0; part < scratch_.kernels.size(); ++part) {
            const PartProfile<T>& profile = setup_.parts[part];
            while (feeds(part) && feeds_[part].next() <= n) {
                feed(part);
            }
            const TileKernels<T>& kernels = scratch_.kernels[part];
            if (!again_of(again, waiting, part) &&
                (next_[part] >= kernels.sections.size() || kernels.sections[next_[part]].first > n)) {
                continue;
            }
            Target<T> targets[covered_slices];
            for (int slice = 0; slice < covered_slices; ++slice) {
                const auto sheet = [&](int channel) {
                    return channel >= 0 ? ring_.plane(n + slice, channel) : nullptr;
                };
                targets[slice] = {sheet(profile.value_channel), sheet(profile.weight_channel),       shape_.stride,
                                  sheet(profile.slope_channel), sheet(profile.weight_slope_channel), ring_.elements()};
            }
            Splat<T, slopes> splat_part{setup_, profile, live_, static_cast<std::int32_t>(n), targets};
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
                    drawn_ += static_cast<std::uint64_t>(add_kernel(splat_part, section, extra, row_shape, count));
                    draw_again(extra.last, number);
                }
            };
            // Kernels of a lattice, which are of one shape: upright, or at least products.
            const RowShape<T>& first_shape = kernels.shapes.front();
            const bool alike = shared_shape && shared_extra && !setup_.slab;
            const bool plain = alike && !setup_.perspective && is_upright(first_shape);
            const bool batches = plain && SphereBatch<T, slopes>::holds(first_shape);
            const bool products =
                alike && !plain && !slopes && are_products(setup_, profile, kernels, shape_, n, lean_[part]);
            const ProductView<T> view =
                product_view(splat_part, first_shape, kernels.reach_x, kernels.reach_y, &lean_[part]);
            const auto draw_upright = [&](auto sums, std::uint32_t number) {
                const Section<T>& section = kernels.sections[number];
                const std::int64_t last = last_of(section, view.deep, kernels.last_slice);
                const int count = slices_left(last);
                if (count > 0) {
                    drawn_ += static_cast<std::uint64_t>(
                        add_spheres<sums.value>(splat_part, section, kernels.weight, first_shape, view.per_X, count));
                    draw_again(last, number);
                }
            };
            // Calls use(draw) with how single kernels of this part are drawn.
            const auto with_way = [&](const auto& use) {
                if (plain) {
                    return with_sums<T>(profile, [&](auto sums) SHEETSPLAT_CPU_INLINE {
                        return use([&](std::uint32_t number) { draw_upright(sums, number); });
                    });
                }
                return use(draw);
            };
            // One slice can hold very many kernels. (Where the picture is given up, so are the sheets.)
            const auto given_up = [&](unsigned drawn) {
                asked_ += drawn;
                return asked_ % splats_between_polls < drawn && !between();
            };
            std::size_t& next = next_[part];
            std::size_t past = next;
            while (past < kernels.sections.size() && kernels.sections[past].first <= n) {
                ++past;
            }
            const auto for_each_waiting = [&](const auto& visit) {
                for (std::size_t entry = 0; entry < waiting; ++entry) {
                    if (again[entry].part == part && !visit(again[entry].section)) {
                        return false;
                    }
                }
                return true;
            };
            const auto draw_each = [&](const auto& draw_one) {
                const auto visit = [&](std::uint32_t number) {
                    draw_one(number);
                    return !given_up(1);
                };
                if (!for_each_waiting(visit)) {
                    return false;
                }
                for (; next < past && !batches; ++next) {
                    if (!visit(static_cast<std::uint32_t>(next))) {
                        return false;
                    }
                }
                return true;
            };
            const auto draw_products = [&](auto sums) SHEETSPLAT_CPU_INLINE {
                ProductBatch<T> batch(view, kernels.last_slice);
                std::uint32_t numbers[ProductBatch<T>::room];
                int together = 0;
                const auto draw_them = [&] {
                    if (together > 0) {
                        drawn_ += static_cast<std::uint64_t>(
                            add_product_batch<sums.value>(splat_part, batch, view, kernels.sections.data(), numbers,
                                                          together, kernels.weight, draw_again));
                    }
                    return !given_up(static_cast<unsigned>(std::exchange(together, 0)));
                };
                const auto visit = [&](std::uint32_t number) {
                    numbers[together++] = number;
                    return together < ProductBatch<T>::room || draw_them();
                };
                if (!for_each_waiting(visit)) {
                    return false;
                }
                for (; next < past; ++next) {
                    if (!visit(static_cast<std::uint32_t>(next))) {
                        return false;
                    }
                }
                return draw_them();
            };
            const auto draw_all = [&] {
                if constexpr (!slopes) {
                    if (products) {
                        return with_sums<T>(profile, draw_products);
                    }
                }
                return with_way(draw_each);
            };
            const bool all_drawn = draw_all();
            if (!all_drawn) {
                return false;
            }
            SphereBatch<T, slopes> batch(first_shape, profile.falloff_log2, kernels.last_slice);
            const auto draw_batch = [&](auto sums, unsigned number) {
                return add_sphere_batch<sums.value>(
                    splat_part, batch, kernels.sections.data() + next, static_cast<int>(number), kernels.weight,
                    [&](std::int64_t last, int kernel) {
                        draw_again(last, static_cast<std::uint32_t>(next) + static_cast<std::uint32_t>(kernel));
                    });
            };
            while (next < past) {
                const auto number =
                    static_cast<unsigned>(std::min<std::size_t>(past - next, SphereBatch<T, slopes>::room));
                const int drawn =
                    with_sums<T>(profile, [&](auto sums) SHEETSPLAT_CPU_INLINE { return draw_batch(sums, number); });
                drawn_ += static_cast<std::uint64_t>(drawn);
                next += number;
                if (given_up(number)) {
                    return false;
                }
            }
            splat_part.tell([&](std::int32_t slice, const Rect& rect) {
                ring_.touch(slice, rect);
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
        window.rect = Rect{std::max(rect.x0 - 1, 0), std::max(rect.y0 - 1, 0), std::min(rect.x1 - 1, shape_.width),
                           std::min(rect.y1 - 1, shape_.height)};
        if (window.rect.empty()) {
            return;
        }
        find_sheets(setup_.groups.front(), n, window);
        for (std::size_t later = 0; later < later_.size(); ++later) {
            find_sheets(setup_.groups[later + 1], n, later_[later]);
        }
        window.later_groups = later_.data();
        if (records(SliceRecord::Of::rho)) {
            record_rho(n, window.rho[1], window.rect);
            return;
        }
        if (setup_.record != nullptr) {
            absorb_slab(*setup_.shading, shape_, window, scratch_.planes);
            return;
        }
        shade_slab(*setup_.shading, shape_, window, scratch_.planes);
    }

    /// The sheets of a group around slice n.
    void find_sheets(const GroupSheets<T>& group, std::int64_t n, SheetWindow<T>& window) const {
        const auto sheet = [&](std::int64_t slice, int channel) -> const T* {
            return ring_.find(slice) != nullptr ? ring_.plane(slice, channel) : scratch_.zeros.data();
        };
        for (int around = 0; around < (setup_.intervals ? 4 : 3); ++around) {
            window.rho[around] = sheet(n - 1 + around, group.rho_channel);
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
    std::vector<RowFeed<T>> feeds_;       ///< of the lattices, the first parts
    std::optional<KeptOfPixels<T>> kept_; ///< where sums over slices are clipped
    bool all_summed_ = true;              ///< all lattices have been added to the picture
    std::vector<SheetWindow<T>> later_ = std::vector<SheetWindow<T>>(setup_.groups.size() - 1);
    unsigned asked_ = 0;
    unsigned changes_ = 0;
    std::vector<std::size_t> next_ = std::vector<std::size_t>(scratch_.kernels.size(), 0);
    std::vector<LeanTables<T>> lean_ = std::vector<LeanTables<T>>(scratch_.kernels.size()); ///< one a part
    std::int64_t last_touched_ = -1;
    std::int64_t ended_ = -3;   ///< slice up to which pixels at the depth limit are counted as finished
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
