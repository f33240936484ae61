// How the samples of a lattice look from a tile.

#if defined(SHEETSPLAT_CPU_FEED_ROWS_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef SHEETSPLAT_CPU_FEED_ROWS_INL
#undef SHEETSPLAT_CPU_FEED_ROWS_INL
#else
#define SHEETSPLAT_CPU_FEED_ROWS_INL
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include <glm/geometric.hpp>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "feed-inl.hpp"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Kernels of a lattice for a tile, by first slices.
template <class T>
class RowFeed {
  public:
    RowFeed(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling,
            const TileShape& tile, TileKernels<T>& kernels)
        : view_(view), runs_(runs), frame_(frame), slab_(sampling == Sampling::slab), tile_(tile), kernels_(kernels),
          perspective_(frame.projection == Projection::perspective),
          basis_(view.to_unit * glm::dvec2(frame.pixel, 0.0), view.to_unit * glm::dvec2(0.0, -frame.pixel)),
          origin_(origin_of(tile, frame)), per_spacing_(1.0 / frame.slice_spacing),
          per_half_depth_(1.0 / view.half_depth), reach_(view.half_depth * per_spacing_ + (slab_ ? 0.5 : 0.0)),
          last_slice_(static_cast<double>(frame.slices - 1)), own_(tile, frame) {
        // Per slice: the point moves along the ray, and the sphere's centre leans away.
        const glm::dvec2 ray = perspective_ ? view.to_unit * origin_ : glm::dvec2(0.0);
        const glm::dvec2 drift = frame.slice_spacing * (ray + per_half_depth_ * view.shear);
        step_slice_ =
            Vec3(glm::dot(basis_.q1, drift), glm::dot(basis_.q2, drift), -frame.slice_spacing * per_half_depth_);
        step_unit_ = unit_at(view.first_eye + view.step_i) - unit_at(view.first_eye);
    }

    void run(const RowPart* begin, const RowPart* end) {
        kernels_.clear();
        RowShape<T> shape;
        shape.X = static_cast<T>(basis_.X);
        shape.Y1 = static_cast<T>(basis_.Y1);
        shape.Y2 = static_cast<T>(basis_.Y2);
        shape.d1 = static_cast<T>(step_slice_.x);
        shape.d2 = static_cast<T>(step_slice_.y);
        shape.ds = static_cast<T>(step_slice_.z);
        kernels_.shapes.assign(1, shape);
        kernels_.weight = static_cast<T>(view_.weight_scale);
        kernels_.last_slice = static_cast<std::int32_t>(frame_.slices - 1);
        if (slab_) {
            one_by_one(begin, end);
        } else {
            in_order(begin, end);
        }
    }

  private:
    [[nodiscard]] Vec3 unit_at(const Vec3& eye) const {
        // On slice 0.
        const double s = (-eye.z - frame_.first_depth) * per_half_depth_;
        const glm::dvec2 from = (perspective_ ? frame_.first_depth * origin_ : origin_) - glm::dvec2(eye.x, eye.y);
        const glm::dvec2 plane = view_.to_unit * from - s * view_.shear;
        return Vec3(glm::dot(basis_.q1, plane), glm::dot(basis_.q2, plane), s);
    }

    /// A stretch of drawn samples.
    struct Stretch {
        std::size_t row;
        std::uint32_t begin, end;
        double depth, step; ///< in slices from slice 0
        Vec3 eye;
    };

    template <class Visit>
    void for_each_stretch(const RowPart* begin, const RowPart* end, const Visit& visit) const {
        const auto& dims = view_.field->shape();
        std::size_t samples = 0;
        for (const RowPart* part = begin; part != end; ++part) {
            samples += part->end - part->begin;
            if (samples >= samples_between_polls && kernels_.poll) {
                kernels_.poll();
                samples = 0;
            }
            const Run* past = runs_.end(part->row);
            const Run* run = runs_.begin(part->row);
            if (past - run > 8) {
                run = std::partition_point(run, past, [&](const Run& r) { return r.end <= part->begin; });
            }
            for (; run != past && run->begin < part->end; ++run) {
                Stretch stretch;
                stretch.row = part->row;
                stretch.begin = std::max(run->begin, part->begin);
                stretch.end = std::min(run->end, part->end);
                if (stretch.begin >= stretch.end) {
                    continue;
                }
                stretch.eye = view_.eye_position(stretch.begin, part->row % dims[1], part->row / dims[1]);
                stretch.depth = (-stretch.eye.z - frame_.first_depth) * per_spacing_;
                stretch.step = -view_.step_i.z * per_spacing_;
                visit(stretch);
            }
        }
    }

    [[nodiscard]] HWY_INLINE double first_of(double depth) const { return std::max(std::ceil(depth - reach_), 0.0); }
    [[nodiscard]] HWY_INLINE double last_of(double depth) const {
        return std::min(std::floor(depth + reach_), last_slice_);
    }

    /// How many of a stretch's centres lie in the tile's own part of the picture.
    [[nodiscard]] std::size_t owned(const Stretch& stretch) const {
        const std::uint32_t count = stretch.end - stretch.begin;
        if (perspective_) {
            std::size_t sum = 0;
            for (std::uint32_t i = 0; i < count; ++i) {
                const Vec3 eye = stretch.eye + static_cast<double>(i) * view_.step_i;
                const double depth = std::max(-eye.z, frame_.first_depth);
                sum += own_.hold((eye.x / depth - origin_.x) / frame_.pixel, (origin_.y - eye.y / depth) / frame_.pixel)
                           ? 1U
                           : 0U;
            }
            return sum;
        }
        double low = 0.0, high = static_cast<double>(count);
        const auto cut = [&](double at, double step, double from, double to) {
            if (step < 0.0) {
                at = -at;
                step = -step;
                std::swap(from, to);
                from = -from;
                to = -to;
            }
            if (step == 0.0) {
                high = at >= from && at < to ? high : low;
                return;
            }
            low = std::max(low, std::ceil((from - at) / step));
            high = std::min(high, std::ceil((to - at) / step));
        };
        cut((stretch.eye.x - origin_.x) / frame_.pixel, view_.step_i.x / frame_.pixel, own_.left, own_.right);
        cut((origin_.y - stretch.eye.y) / frame_.pixel, -view_.step_i.y / frame_.pixel, own_.top, own_.bottom);
        return high > low ? static_cast<std::size_t>(high - low) : 0;
    }

    /// Samples that are looked at together.
    static constexpr std::uint32_t block = 64;

    template <class Visit>
    static HWY_INLINE void for_each_block(const Stretch& stretch, const Visit& visit) {
        const std::uint32_t count = stretch.end - stretch.begin;
        for (std::uint32_t from = 0; from < count; from += block) {
            visit(from, std::min(block, count - from));
        }
    }

    /// First slices, counted from `least`; those beyond `most` under the one after it. A function of its own: inlined
    /// twice, it could be rounded in two ways, and kernels would not find the places that were counted for them.
    HWY_NOINLINE void slots_of(const Stretch& stretch, std::uint32_t from, std::uint32_t samples, double least,
                               double most, std::int32_t* slots) const {
        for (std::uint32_t i = 0; i < samples; ++i) {
            const auto along = static_cast<double>(static_cast<std::int32_t>(from + i));
            const double first = first_of(stretch.depth + along * stretch.step);
            slots[i] = static_cast<std::int32_t>(std::min(std::max(first, least), most + 1.0) - least);
        }
    }

    /// Point sampling: two passes, the first one to count, so that every kernel is written once, where it belongs.
    void in_order(const RowPart* begin, const RowPart* end) {
        double least = std::numeric_limits<double>::infinity(), most = -1.0;
        std::size_t count = 0;
        for_each_stretch(begin, end, [&](const Stretch& stretch) {
            const double far = stretch.depth + static_cast<double>(stretch.end - stretch.begin - 1) * stretch.step;
            least = std::min({least, first_of(stretch.depth), first_of(far)});
            most = std::max({most, first_of(stretch.depth), first_of(far)});
            count += stretch.end - stretch.begin;
            kernels_.counted += owned(stretch);
        });
        if (count == 0 || !(least <= last_slice_)) {
            return;
        }
        // A kernel that ends on a slice may have been rounded to the other side of it here.
        least = std::max(least - 1.0, 0.0);
        most = std::min(most + 1.0, last_slice_);
        const std::size_t starts = static_cast<std::size_t>(most - least) + 1;
        if (starts > 4 * count + 1024) {
            one_by_one(begin, end);
            return;
        }
        // (Kernels behind the last slice, or between two, are counted under the slice after their own last one.)
        auto& places = kernels_.places;
        places.assign(starts + 2, 0);
        std::int32_t slots[block];
        for_each_stretch(begin, end, [&](const Stretch& stretch) {
            for_each_block(stretch, [&](std::uint32_t from, std::uint32_t samples) {
                slots_of(stretch, from, samples, least, most, slots);
                for (std::uint32_t i = 0; i < samples; ++i) {
                    ++places[static_cast<std::size_t>(slots[i]) + 1];
                }
            });
        });
        for (std::size_t start = 1; start <= starts + 1; ++start) {
            places[start] += places[start - 1];
        }
        const std::size_t kept = places[starts];
        kernels_.sections.resize(places[starts + 1]);
        const auto& dims = view_.field->shape();
        const double value_scale = view_.value_scale;
        const double per_slice = frame_.slice_spacing * per_half_depth_;
        Section<T>* sections = kernels_.sections.data();
        std::visit(
            [&](const auto& data) {
                for_each_stretch(begin, end, [&](const Stretch& stretch) {
                    const auto* values = data.data() + stretch.row * dims[2] + stretch.begin;
                    const Vec3 unit = unit_at(stretch.eye);
                    for_each_block(stretch, [&](std::uint32_t from, std::uint32_t samples) {
                        slots_of(stretch, from, samples, least, most, slots);
                        // Numbers first, in loops that the compiler makes vectors of; then each to its place.
                        T a1[block], a2[block], s[block], value[block];
                        for (std::uint32_t i = 0; i < samples; ++i) {
                            const auto along = static_cast<double>(static_cast<std::int32_t>(from + i));
                            const double first = static_cast<double>(slots[i]) + least;
                            a1[i] = static_cast<T>(unit.x + along * step_unit_.x + first * step_slice_.x);
                            a2[i] = static_cast<T>(unit.y + along * step_unit_.y + first * step_slice_.y);
                            s[i] = static_cast<T>((stretch.depth + along * stretch.step - first) * per_slice);
                            value[i] = static_cast<T>(static_cast<double>(values[from + i]) * value_scale);
                        }
                        const auto origin = static_cast<std::int32_t>(least);
                        for (std::uint32_t i = 0; i < samples; ++i) {
                            Section<T>& section = sections[places[static_cast<std::size_t>(slots[i])]++];
                            section.a1 = a1[i];
                            section.a2 = a2[i];
                            section.s = s[i];
                            section.value = value[i];
                            section.first = slots[i] + origin;
                        }
                    });
                });
            },
            view_.field->samples());
        kernels_.sections.resize(kept);
    }

    /// With the pixels that each can touch; sorted afterwards.
    void one_by_one(const RowPart* begin, const RowPart* end) {
        const auto& dims = view_.field->shape();
        const double half_x = view_.extent_x / frame_.pixel, half_y = view_.extent_y / frame_.pixel;
        const double spacing = frame_.slice_spacing;
        const T weight = static_cast<T>(view_.weight_scale);
        kernels_.counted = 0;
        std::visit(
            [&](const auto& data) {
                for_each_stretch(begin, end, [&](const Stretch& stretch) {
                    kernels_.counted += owned(stretch);
                    const auto* values = data.data() + stretch.row * dims[2] + stretch.begin;
                    const Vec3 unit = unit_at(stretch.eye);
                    for (std::uint32_t i = 0; i < stretch.end - stretch.begin; ++i) {
                        const auto along = static_cast<double>(i);
                        const double depth = stretch.depth + along * stretch.step;
                        const double first = first_of(depth), last = last_of(depth);
                        SectionExtra<T> extra;
                        if (!(first <= last) ||
                            !place(box_of(stretch.eye + along * view_.step_i, first, last, half_x, half_y), tile_,
                                   extra)) {
                            continue;
                        }
                        extra.weight = weight;
                        extra.last = static_cast<std::int32_t>(last);
                        Section<T> section;
                        section.first = static_cast<std::int32_t>(first);
                        section.a1 = static_cast<T>(unit.x + along * step_unit_.x + first * step_slice_.x);
                        section.a2 = static_cast<T>(unit.y + along * step_unit_.y + first * step_slice_.y);
                        section.s = static_cast<T>((depth - first) * spacing * per_half_depth_);
                        section.value = static_cast<T>(static_cast<double>(values[i]) * view_.value_scale);
                        kernels_.unsorted.push_back(section);
                        kernels_.unsorted_extras.push_back(extra);
                    }
                });
            },
            view_.field->samples());
        kernels_.sort();
    }

    [[nodiscard]] SheetBox box_of(const Vec3& eye, double first, double last, double half_x, double half_y) const {
        if (!perspective_) {
            const double x = (eye.x - origin_.x) / frame_.pixel, y = (origin_.y - eye.y) / frame_.pixel;
            return {x - half_x, x + half_x, y - half_y, y + half_y};
        }
        const double spacing = frame_.slice_spacing;
        const double near = std::max(-eye.z - view_.half_depth, frame_.first_depth + first * spacing - view_.slab_half);
        const double far =
            std::max(near, std::min(-eye.z + view_.half_depth, frame_.first_depth + last * spacing + view_.slab_half));
        if (near <= 1e-9 * spacing) {
            return {0.0, tile_.width + 1.0, 0.0, tile_.height + 1.0};
        }
        // (c +- e) / t is monotonic in t, so that the extremes lie at the nearest or farthest depth.
        const auto lowest = [&](double edge) { return std::min(edge / near, edge / far); };
        const auto highest = [&](double edge) { return std::max(edge / near, edge / far); };
        return {(lowest(eye.x - view_.extent_x) - origin_.x) / frame_.pixel,
                (highest(eye.x + view_.extent_x) - origin_.x) / frame_.pixel,
                (origin_.y + lowest(-eye.y - view_.extent_y)) / frame_.pixel,
                (origin_.y + highest(-eye.y + view_.extent_y)) / frame_.pixel};
    }

    const FieldView& view_;
    const VisibleRuns& runs_;
    const Frame& frame_;
    bool slab_;
    const TileShape& tile_;
    TileKernels<T>& kernels_;
    bool perspective_;
    RowBasis basis_;
    glm::dvec2 origin_;
    double per_spacing_, per_half_depth_, reach_, last_slice_;
    OwnPlaces own_;
    Vec3 step_slice_{0.0}, step_unit_{0.0};
};

template <class T>
void feed_rows(const FieldView& view, const VisibleRuns& runs, const Frame& frame, Sampling sampling,
               const RowPart* begin, const RowPart* end, const TileShape& tile, TileKernels<T>& kernels) {
    RowFeed<T>(view, runs, frame, sampling, tile, kernels).run(begin, end);
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_FEED_ROWS_INL
