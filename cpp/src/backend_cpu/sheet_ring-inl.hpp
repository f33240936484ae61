// The sheets of one tile: a ring of slices that are filled, looked at and cleared in turn.

#if defined(SHEETSPLAT_CPU_SHEET_RING_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_SHEET_RING_INL
#undef SHEETSPLAT_CPU_SHEET_RING_INL
#else
#define SHEETSPLAT_CPU_SHEET_RING_INL
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend_cpu/tile.hpp"
#include "backend_cpu/tile_task.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// ring_slots slices with `channels` sheets each. Memory is all 0 before and after.
template <class T>
class SheetRing {
  public:
    struct Slot {
        std::int64_t slice = -1; ///< -1: free
        Rect touched;            ///< pixels of the sheets: of all groups
    };

    /// memory: [slot][channel][element].
    SheetRing(T* memory, const LoopSetup<T>& setup, const TileShape& shape)
        : memory_(memory), setup_(setup), shape_(shape), elements_(shape.sheet_elements()),
          parts_(setup.groups.size() + setup.label_sets.size()), touched_(ring_slots * parts_),
          written_(ring_slots * parts_) {}

    [[nodiscard]] std::size_t elements() const { return elements_; }
    /// Null where nothing has been added to slice n.
    [[nodiscard]] const Slot* find(std::int64_t n) const {
        if (n < 0) {
            return nullptr;
        }
        const Slot& slot = slots_[index_of(n)];
        return slot.slice == n ? &slot : nullptr;
    }
    [[nodiscard]] T* plane(std::int64_t n, int channel) const {
        const std::size_t number =
            index_of(n) * static_cast<std::size_t>(setup_.channels) + static_cast<std::size_t>(channel);
        return memory_ + number * elements_;
    }
    /// Pixels of a group's sheets of a slice that kernels have been added to.
    [[nodiscard]] Rect touched(std::int64_t n, std::size_t group) const {
        return find(n) != nullptr ? touched_[index_of(n) * parts_ + group] : Rect();
    }

    void touch(std::int64_t n, const Rect& rect, std::size_t group) {
        Slot& slot = slots_[index_of(n)];
        slot.slice = n;
        slot.touched.add(rect);
        touched_[index_of(n) * parts_ + group].add(rect);
        write(n, rect, group);
    }
    /// Before anything is written to a slice that kernels may not have been added to.
    void open(std::int64_t n) { slots_[index_of(n)].slice = n; }
    /// Of a slice that kernels have been added to: what else is written to a group's sheets, and to that of a set of
    /// labels.
    void write(std::int64_t n, const Rect& rect, std::size_t group) {
        written_[index_of(n) * parts_ + group].add(rect);
    }
    void write_set(std::int64_t n, const Rect& rect, std::size_t set) { write(n, rect, setup_.groups.size() + set); }
    void release(std::int64_t n) {
        if (find(n) != nullptr) {
            clear(slots_[index_of(n)]);
        }
    }
    void release_all() {
        for (Slot& slot : slots_) {
            clear(slot);
        }
    }

  private:
    [[nodiscard]] static std::size_t index_of(std::int64_t n) { return static_cast<std::size_t>(n) % ring_slots; }

    void clear(Slot& slot) {
        if (slot.slice < 0) {
            return;
        }
        for (std::size_t part = 0; part < parts_; ++part) {
            Rect& rect = written_[index_of(slot.slice) * parts_ + part];
            if (part >= setup_.groups.size()) {
                clear(slot.slice, setup_.label_sets[part - setup_.groups.size()].absent_channel, rect);
            } else if (!rect.empty()) {
                for (const int channel : setup_.groups[part].channels) {
                    clear(slot.slice, channel, rect);
                }
            }
            rect = touched_[index_of(slot.slice) * parts_ + part] = Rect();
        }
        slot = Slot{};
    }
    void clear(std::int64_t n, int channel, const Rect& rect) {
        // Vectors run over both ends of what was touched, and rounding may have left something there.
        const int first = rect.x0 & ~(TileShape::padding - 1);
        const int past = std::min(rect.x1 + TileShape::padding, shape_.stride);
        T* sheet = plane(n, channel);
        for (int y = rect.y0; y < rect.y1; ++y) {
            T* row = sheet + static_cast<std::ptrdiff_t>(y) * shape_.stride;
            std::fill(row + first, row + past, T(0));
        }
    }

    T* memory_;
    const LoopSetup<T>& setup_;
    const TileShape& shape_;
    std::size_t elements_;
    std::size_t parts_; ///< groups, then sets of labels
    Slot slots_[ring_slots];
    std::vector<Rect> touched_, written_; ///< [slot][part]
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SHEET_RING_INL
