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
        Rect touched;            ///< pixels of the sheets
    };

    /// memory: [slot][channel][element].
    SheetRing(T* memory, int channels, const TileShape& shape)
        : memory_(memory), channels_(channels), shape_(shape), elements_(shape.sheet_elements()) {}

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
            index_of(n) * static_cast<std::size_t>(channels_) + static_cast<std::size_t>(channel);
        return memory_ + number * elements_;
    }

    void touch(std::int64_t n, const Rect& rect) {
        Slot& slot = slots_[index_of(n)];
        slot.slice = n;
        slot.touched.add(rect);
    }
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
        // Vectors run over both ends of what was touched, and rounding may have left something there.
        const int first = slot.touched.x0 & ~(TileShape::padding - 1);
        const int past = std::min(slot.touched.x1 + TileShape::padding, shape_.stride);
        for (int channel = 0; channel < channels_; ++channel) {
            T* sheet = plane(slot.slice, channel);
            for (int y = slot.touched.y0; y < slot.touched.y1; ++y) {
                T* row = sheet + static_cast<std::ptrdiff_t>(y) * shape_.stride;
                std::fill(row + first, row + past, T(0));
            }
        }
        slot = Slot{};
    }

    T* memory_;
    int channels_;
    const TileShape& shape_;
    std::size_t elements_;
    Slot slots_[ring_slots];
};

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_SHEET_RING_INL
