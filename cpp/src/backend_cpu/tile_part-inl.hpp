// The kernels of one part of a scene on their way through a tile: fed some slices at a time, drawn on the slices that
// they meet, covered_slices at once.

#if defined(SHEETSPLAT_CPU_TILE_PART_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_TILE_PART_INL
#undef SHEETSPLAT_CPU_TILE_PART_INL
#else
#define SHEETSPLAT_CPU_TILE_PART_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

#include "backend_cpu/tile_task.hpp"
#include "feed_rows-inl.hpp"
#include "hwy/highway.h"
#include "live-inl.hpp"
#include "splat-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

template <class T>
class TilePart {
  public:
    /// The slice of a part without further kernels.
    static constexpr std::int64_t none = std::numeric_limits<std::int64_t>::max();

    TilePart(const PartProfile<T>& profile, TileKernels<T>& kernels) : profile_(profile), kernels_(kernels) {
        // (A tile that was given up left some.)
        for (auto& waiting : kernels_.waiting) {
            waiting.clear();
        }
    }

    /// Of a lattice, which is fed here.
    RowFeed<T>& set_feed(const LatticeRows& rows, const TileShape& tile) { return feed_.emplace(rows, tile, kernels_); }

    [[nodiscard]] const PartProfile<T>& profile() const { return profile_; }
    [[nodiscard]] const TileKernels<T>& kernels() const { return kernels_; }

    /// The next slice that a kernel begins on.
    [[nodiscard]] std::int64_t next_start(const Live& live) {
        while (next_ >= kernels_.sections.size() && is_fed()) {
            feed(live);
        }
        return next_ < kernels_.sections.size() ? kernels_.sections[next_].first : none;
    }

    /// Whether anything is to be drawn from slice n on; feeds what begins there.
    [[nodiscard]] bool draws(std::int64_t n, const Live& live) {
        while (is_fed() && feed_->next() <= n) {
            feed(live);
        }
        return !waiting_for(n).empty() || begins_by(n);
    }

    /// The kernels to be drawn again from a slice on.
    [[nodiscard]] std::vector<std::uint32_t>& waiting_for(std::int64_t n) {
        return kernels_.waiting[static_cast<std::size_t>(n) % covered_slices];
    }

    /// Adds what waits for slice splat.n, and what begins there. goes_on(kernels, sections that were drawn of them):
    /// returns false where the picture is given up, and so does this.
    template <bool slopes, class GoesOn>
    bool draw(Splat<T, slopes>& splat, const TileShape& tile, const GoesOn& goes_on) {
        // The list of this slice becomes that of slice n + covered_slices.
        std::vector<std::uint32_t>& now = kernels_.drawn_now;
        now.clear();
        now.swap(waiting_for(splat.n));
        const std::size_t again = now.size(), first = next_;
        while (begins_by(splat.n)) {
            ++next_;
        }
        now.resize(again + next_ - first);
        std::iota(now.begin() + static_cast<std::ptrdiff_t>(again), now.end(), static_cast<std::uint32_t>(first));
        return with_way(splat, kernels_, tile, lean_, [&](auto&& way) {
            for (std::size_t at = 0; at < now.size(); at += batch_room) {
                const std::size_t number = std::min<std::size_t>(now.size() - at, batch_room);
                const int sections = way.draw(now.data() + at, static_cast<int>(number));
                if (!goes_on(static_cast<unsigned>(number), sections)) {
                    return false;
                }
            }
            return true;
        });
    }

  private:
    [[nodiscard]] bool is_fed() const { return feed_ && !feed_->ended(); }
    [[nodiscard]] bool begins_by(std::int64_t n) const {
        return next_ < kernels_.sections.size() && kernels_.sections[next_].first <= n;
    }

    /// Replaces the kernels, of which none but those that wait are drawn again, by those of the next slices.
    void feed(const Live& live) {
        auto& carried = kernels_.carried;
        auto& values = kernels_.carried_values;
        carried.clear();
        values.clear();
        for (auto& waiting : kernels_.waiting) {
            for (std::uint32_t& number : waiting) {
                carried.push_back(kernels_.sections[number]);
                if (kernels_.fields > 1) {
                    const auto own = kernels_.values.begin() + static_cast<std::ptrdiff_t>(number * kernels_.fields);
                    values.insert(values.end(), own, own + static_cast<std::ptrdiff_t>(kernels_.fields));
                }
                number = static_cast<std::uint32_t>(carried.size() - 1);
            }
        }
        kernels_.sections.assign(carried.begin(), carried.end());
        kernels_.values.assign(values.begin(), values.end());
        next_ = carried.size();
        feed_->feed(live);
    }

    const PartProfile<T>& profile_;
    TileKernels<T>& kernels_;
    std::optional<RowFeed<T>> feed_;
    LeanTables<T> lean_;
    std::size_t next_ = 0; ///< kernel that has not been drawn
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_TILE_PART_INL
