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
#include <glm/matrix.hpp>

#include "backend_cpu/measured.hpp"
#include "backend_cpu/tile_feed.hpp"
#include "backend_cpu/tile_task.hpp"
#include "feed-inl.hpp"
#include "feed_values-inl.hpp"
#include "hwy/highway.h"
#include "live-inl.hpp"
#include "plan/limits_common.hpp"
#include "splat_target-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace sheetsplat::backend_cpu::HWY_NAMESPACE {

/// Kernels of a lattice for a tile, by first slices, in batches of slices from front to back: those of which nothing
/// can be seen any more when their batch begins are left out.
template <class T>
class RowFeed {
  public:
    RowFeed(const LatticeRows& rows, const TileShape& tile, TileKernels<T>& kernels)
        : view_(*rows.view), runs_(*rows.runs), frame_(*rows.frame), slab_(rows.sampling == Sampling::slab),
          begin_(rows.begin), end_(rows.end), tile_(tile), kernels_(kernels),
          perspective_(frame_.projection == Projection::perspective),
          basis_(view_.to_unit * glm::dvec2(frame_.pixel, 0.0), view_.to_unit * glm::dvec2(0.0, -frame_.pixel)),
          origin_(origin_of(tile, frame_)), half_x_(view_.extent_x / frame_.pixel),
          half_y_(view_.extent_y / frame_.pixel), per_pixel_(1.0 / frame_.pixel),
          per_spacing_(1.0 / frame_.slice_spacing), per_half_depth_(1.0 / view_.half_depth),
          reach_(view_.half_depth * per_spacing_ + (slab_ ? 0.5 : 0.0)), step_(-view_.step_i.z * per_spacing_),
          per_step_(std::abs(step_) > 1e-9 ? 1.0 / step_ : 0.0), last_slice_(static_cast<double>(frame_.slices - 1)),
          own_(tile, frame_), reader_(*view_.field, view_.field->counted_from() + kernels.pivot, view_.value_scale),
          lean_(view_.half_depth * (glm::inverse(view_.to_unit) * view_.shear)) {
        if (rows.beside != nullptr && !rows.beside->empty()) {
            sources_.push_back({reader_, *rows.own});
            for (const LatticeBeside& beside : *rows.beside) {
                const FieldView& view = *beside.view;
                sources_.push_back({{*view.field, view.field->counted_from(), view.value_scale}, *beside.runs});
            }
        }
        // Per slice: the point moves along the ray, and the sphere's centre leans away.
        const glm::dvec2 ray = perspective_ ? view_.to_unit * origin_ : glm::dvec2(0.0);
        const glm::dvec2 drift = frame_.slice_spacing * (ray + per_half_depth_ * view_.shear);
        step_slice_ =
            Vec3(glm::dot(basis_.q1, drift), glm::dot(basis_.q2, drift), -frame_.slice_spacing * per_half_depth_);
        step_unit_ = unit_at(view_.first_eye + view_.step_i) - unit_at(view_.first_eye);
        constexpr double infinity = std::numeric_limits<double>::infinity();
        const auto rays = [&](int from, int size, int all) {
            return glm::dvec2(from == 0 ? -infinity : (from - 0.5 * all) * frame_.pixel,
                              from + size == all ? infinity : (from + size - 0.5 * all) * frame_.pixel);
        };
        own_rays_x_ = rays(tile.x, tile.width, frame_.size.width);
        own_rays_y_ = rays(tile.y, tile.height, frame_.size.height);
        kernels_.clear();
        kernels_.fields = std::max<std::size_t>(sources_.size(), 1);
        kernels_.shapes.assign(1, row_shape<T>(basis_, drift, -step_slice_.z));
        if (!view_.unfiltered) {
            kernels_.reach_x = static_cast<T>(
                reach_px(view_.extent_x, lean_.x, origin_.x, origin_.x + (tile_.width + 1) * frame_.pixel));
            kernels_.reach_y = static_cast<T>(
                reach_px(view_.extent_y, lean_.y, origin_.y, origin_.y - (tile_.height + 1) * frame_.pixel));
        }
        kernels_.weight = static_cast<T>(view_.weight_scale);
        kernels_.last_slice = static_cast<std::int32_t>(frame_.slices - 1);
    }

    /// To be called before the first batch.
    void begin() { at_once_ = slab_ || view_.unfiltered || !plan_batches(); }

    [[nodiscard]] bool ended() const { return batch_ == batches_; }
    /// Kernels that begin before this slice have been fed.
    [[nodiscard]] std::int64_t next() const { return static_cast<std::int64_t>(least_) + batch_ * length_; }

    /// Adds the kernels of one more batch behind what there is.
    void feed(const Live& live) {
        if (at_once_) {
            one_by_one();
        } else {
            in_order(live);
            ++batch_;
        }
    }

    /// Calls visit(sample, eye, count) for neighbouring drawn samples of each row: the first one's number and place,
    /// how many. In place of batches.
    template <class Visit>
    void for_each_stretch(const Visit& visit) {
        kernels_.counted = 0;
        for (const RowPart* part = begin_; part != end_; ++part) {
            kernels_.counted += owned(*part);
            poll_after(part->end - part->begin);
            for_each_run(runs_, *part, part->begin, part->end, [&](const Run&, std::uint32_t begin, std::uint32_t end) {
                visit(row_begin(part->row) + begin, eye_of(part->row, begin), end - begin);
            });
        }
        batch_ = batches_;
    }
    [[nodiscard]] const SampleReader<T>& reader() const { return reader_; }

    /// A half space beside the samples of a row.
    struct RowCut {
        Vec3 normal;
        double distance;
        double step;  ///< of the distance from its plane, from sample to sample
        double reach; ///< of a support, towards the plane
    };
    [[nodiscard]] std::vector<RowCut> row_cuts(const std::vector<KeptHalfSpace>& kept) const {
        // Steps are semi-axes, but for BCC lattices, whose kernels are spheres.
        const double radius = view_.field->options().radius;
        const glm::dmat3 own = view_.field->kernel_axes().is_sphere()
                                   ? glm::dmat3(view_.field->kernel_axes().lengths.x)
                                   : radius * glm::dmat3(view_.step_i, view_.step_j, view_.step_k);
        // A filter adds to the squares of the extents along the picture's axes.
        const glm::dmat3 rows = glm::transpose(own);
        const Vec3 wide(view_.extent_x, view_.extent_y, view_.half_depth);
        const Vec3 added =
            wide * wide - Vec3(glm::dot(rows[0], rows[0]), glm::dot(rows[1], rows[1]), glm::dot(rows[2], rows[2]));
        std::vector<RowCut> cuts;
        cuts.reserve(kept.size());
        for (const KeptHalfSpace& half : kept) {
            const Vec3 along = half.normal * own;
            const double squared = glm::dot(along, along) + std::max(0.0, glm::dot(half.normal * half.normal, added));
            cuts.push_back(
                {half.normal, half.distance, glm::dot(half.normal, view_.step_i), std::sqrt(squared) * (1.0 + 1e-9)});
        }
        return cuts;
    }

    /// Of `count` neighbouring samples from one at `eye` on, those whose supports half spaces keep as a whole: begin <=
    /// i < end.
    [[nodiscard]] static std::pair<std::uint32_t, std::uint32_t> wholly_kept(const std::vector<RowCut>& cuts,
                                                                             const Vec3& eye, std::uint32_t count) {
        const auto most = static_cast<double>(count);
        SampleCut cut{0.0, most};
        for (const RowCut& half : cuts) {
            const double at = glm::dot(half.normal, eye) + half.distance - half.reach;
            // (Mostly all of them are.)
            if (!(std::min(at, at + (most - 1.0) * half.step) >= 0.0)) {
                cut.keep(at, half.step, 0.0, std::numeric_limits<double>::infinity());
            }
        }
        if (!(cut.low < cut.high)) {
            return {0, 0};
        }
        return {static_cast<std::uint32_t>(cut.low), static_cast<std::uint32_t>(cut.high)};
    }

    /// In orthographic views: pixels of the tile's sheets, and slices from slice 0.
    [[nodiscard]] Vec3 place_of(const Vec3& eye) const {
        return {(eye.x - origin_.x) * per_pixel_, (origin_.y - eye.y) * per_pixel_, depth_of(eye)};
    }
    /// From sample to sample of a row.
    [[nodiscard]] Vec3 step_of_places() const {
        return {view_.step_i.x * per_pixel_, -view_.step_i.y * per_pixel_, step_};
    }

  private:
    [[nodiscard]] Vec3 unit_at(const Vec3& eye) const {
        // On slice 0.
        const double s = (-eye.z - frame_.first_depth) * per_half_depth_;
        const glm::dvec2 from = (perspective_ ? frame_.first_depth * origin_ : origin_) - glm::dvec2(eye.x, eye.y);
        const glm::dvec2 plane = view_.to_unit * from - s * view_.shear;
        return Vec3(glm::dot(basis_.q1, plane), glm::dot(basis_.q2, plane), s);
    }
    /// Half the extent of a support across a ray of slope f is |B^T (1, 0, f)|, which is convex in f: between the
    /// tile's two outermost rays it is largest at one of them. lean: B's row of x (or y) times that of z.
    [[nodiscard]] double reach_px(double extent, double lean, double f, double g) const {
        if (!perspective_) {
            return extent / frame_.pixel;
        }
        const auto across = [&](double slope) {
            return std::max(0.0, extent * extent + slope * (2.0 * lean + slope * view_.half_depth * view_.half_depth));
        };
        return std::sqrt(std::max(across(f), across(g))) / frame_.pixel;
    }

    [[nodiscard]] Vec3 eye_of(std::size_t row, std::uint32_t sample) const {
        const std::size_t rows = view_.field->shape()[1];
        return view_.eye_position(sample, row % rows, row / rows);
    }
    /// Where a row begins in the field's samples.
    [[nodiscard]] std::size_t row_begin(std::size_t row) const {
        const std::size_t rows = view_.field->shape()[1];
        return view_.field->row(row % rows, row / rows);
    }
    [[nodiscard]] HWY_INLINE double depth_of(const Vec3& eye) const {
        return (-eye.z - frame_.first_depth) * per_spacing_;
    }
    [[nodiscard]] HWY_INLINE double first_of(double depth) const { return std::max(std::ceil(depth - reach_), 0.0); }
    [[nodiscard]] HWY_INLINE double last_of(double depth) const {
        return std::min(std::floor(depth + reach_), last_slice_);
    }

    void poll_after(std::size_t samples) {
        looked_at_ += samples;
        if (looked_at_ >= samples_between_polls && kernels_.poll) {
            kernels_.poll();
            looked_at_ = 0;
        }
    }

    /// Calls visit(begin, end) for the drawn samples of a part of a row that lie between two numbers.
    template <class Visit>
    HWY_INLINE static void for_each_run(const VisibleRuns& runs, const RowPart& part, std::uint32_t begin,
                                        std::uint32_t end, const Visit& visit) {
        const Run* past = runs.end(part.row);
        for (const Run* run = run_behind(runs.begin(part.row), past, begin); run != past && run->begin < end; ++run) {
            visit(*run, std::max(run->begin, begin), std::min(run->end, end));
        }
    }

    /// How many drawn samples of a part of a row have their centres in the tile's own part of the picture.
    [[nodiscard]] std::size_t owned(const RowPart& part) const {
        std::size_t sum = 0;
        const auto add = [&](const SampleCut& cut) {
            if (cut.low < cut.high) {
                const auto count = [&](const VisibleRuns& runs) {
                    for_each_run(runs, part, static_cast<std::uint32_t>(cut.low), static_cast<std::uint32_t>(cut.high),
                                 [&](const Run&, std::uint32_t begin, std::uint32_t end) { sum += end - begin; });
                };
                if (sources_.empty()) {
                    count(runs_);
                }
                for (const LatticeSource<T>& source : sources_) {
                    count(source.runs);
                }
            }
        };
        // From the row's first sample on, and in pixels of the picture, so that neighbouring tiles cut at one sample.
        const Vec3 eye = eye_of(part.row, 0);
        const double begin = part.begin, end = part.end;
        if (!perspective_) {
            SampleCut cut{begin, end};
            const double left = tile_.x - 0.5, top = tile_.y - 0.5;
            cut.keep(eye.x * per_pixel_ + frame_.axis_x, view_.step_i.x * per_pixel_, own_.left + left,
                     own_.right + left);
            cut.keep(frame_.axis_y - eye.y * per_pixel_, -view_.step_i.y * per_pixel_, own_.top + top,
                     own_.bottom + top);
            add(cut);
            return sum;
        }
        // Centres before the first slice are seen at its depth. Inside the tile's outermost rays linear functions are
        // positive.
        const auto inside = [&](double from, double past, double t, double step_t) {
            constexpr double infinity = std::numeric_limits<double>::infinity();
            SampleCut cut{from, past};
            const auto between = [&](double w, double step_w, const glm::dvec2& rays) {
                if (rays.x > -infinity) {
                    cut.keep(w - rays.x * t, step_w - rays.x * step_t, 0.0, infinity);
                }
                if (rays.y < infinity) {
                    cut.keep(w - rays.y * t, step_w - rays.y * step_t, -infinity, 0.0);
                }
            };
            between(eye.x, view_.step_i.x, own_rays_x_);
            between(-eye.y, -view_.step_i.y, own_rays_y_);
            add(cut);
        };
        const double first = frame_.first_depth, depth = -eye.z, step = -view_.step_i.z;
        const double met = std::abs(step) < least_step ? (depth < first ? end : begin)
                                                       : std::clamp(std::ceil((first - depth) / step), begin, end);
        if (step < 0.0) {
            inside(begin, met, depth, step);
            inside(met, end, first, 0.0);
        } else {
            inside(begin, met, first, 0.0);
            inside(met, end, depth, step);
        }
        return sum;
    }

    /// Sorts the parts of rows by the batches that their samples begin in; false where there are too few samples for so
    /// many slices.
    bool plan_batches() {
        RowBatches& rows = kernels_.rows;
        const auto parts = static_cast<std::size_t>(end_ - begin_);
        // First slices; what rounding moves to the next one is found in the next one too.
        std::vector<double>& firsts = rows.firsts;
        firsts.resize(2 * parts);
        rows.eyes.resize(parts);
        double least = std::numeric_limits<double>::infinity(), most = -1.0;
        std::size_t count = 0;
        for (std::size_t number = 0; number < parts; ++number) {
            const RowPart& part = begin_[number];
            const Vec3 eye = eye_of(part.row, part.begin);
            rows.eyes[number] = {eye.x, eye.y, eye.z};
            const double depth = depth_of(eye);
            const double far = depth + static_cast<double>(part.end - 1 - part.begin) * step_;
            firsts[2 * number] = std::max(first_of(std::min(depth, far)) - 1.0, 0.0);
            firsts[2 * number + 1] = std::min(first_of(std::max(depth, far)) + 1.0, last_slice_);
            least = std::min(least, firsts[2 * number]);
            most = std::max(most, firsts[2 * number + 1]);
            count += part.end - part.begin;
            kernels_.counted += owned(part);
            poll_after(part.end - part.begin);
        }
        if (!(least <= most)) {
            batches_ = 0;
            return true;
        }
        if (sources_.empty() && most - least > static_cast<double>(4 * count + 1024)) {
            return false;
        }
        least_ = least;
        past_ = most + 1.0;
        length_ = std::max<std::int64_t>(batch_slices, static_cast<std::int64_t>((past_ - least_) / most_batches) + 1);
        const double per_batch = 1.0 / static_cast<double>(length_);
        batches_ = static_cast<std::int64_t>((past_ - 1.0 - least_) * per_batch) + 1;
        rows.offset.assign(static_cast<std::size_t>(batches_) + 2, 0);
        const auto for_each_batch = [&](std::size_t number, const auto& visit) {
            if (firsts[2 * number] <= firsts[2 * number + 1]) {
                const auto last = static_cast<std::size_t>((firsts[2 * number + 1] - least_) * per_batch);
                for (auto at = static_cast<std::size_t>((firsts[2 * number] - least_) * per_batch); at <= last; ++at) {
                    visit(at);
                }
            }
        };
        for (std::size_t number = 0; number < parts; ++number) {
            for_each_batch(number, [&](std::size_t batch) { ++rows.offset[batch + 2]; });
        }
        for (std::size_t batch = 2; batch < rows.offset.size(); ++batch) {
            rows.offset[batch] += rows.offset[batch - 1];
        }
        rows.parts.resize(rows.offset.back());
        for (std::size_t number = 0; number < parts; ++number) {
            for_each_batch(number, [&](std::size_t batch) {
                rows.parts[rows.offset[batch + 1]++] = static_cast<std::uint32_t>(number);
            });
        }
        return true;
    }

    /// Whether anything can still be seen of samples begin ... end - 1 of a row.
    [[nodiscard]] HWY_INLINE bool seen(const Live& live, const Vec3& from, std::uint32_t count) const {
        if (live.rows == nullptr) {
            return true;
        }
        const Vec3 to = from + static_cast<double>(count - 1) * view_.step_i;
        const SheetBox box = box_between(from, to);
        // Boxes as the splat loops find them, in T, and a little more.
        const int x0 = whole(box.left - 0.01, live.rect.x0, live.rect.x1);
        const int y0 = whole(box.top - 0.01, live.rect.y0, live.rect.y1);
        const int x1 = whole(box.right + 1.01, live.rect.x0, live.rect.x1);
        const int y1 = whole(box.bottom + 1.01, live.rect.y0, live.rect.y1);
        return x0 < x1 && y0 < y1 && live.sees(x0, y0, x1, y1);
    }

    /// Point sampling: two passes, the first one to count, so that every kernel is written once, where it belongs.
    void in_order(const Live& live) {
        RowBatches& rows = kernels_.rows;
        const auto batch = static_cast<std::size_t>(batch_);
        const double least = least_ + static_cast<double>(batch_ * length_);
        const double past = std::min(least + static_cast<double>(length_), past_);
        const auto slots = static_cast<std::int32_t>(past - least);
        auto& places = kernels_.places;
        // (Kernels of other batches, or between two slices, are counted under the slot after the last one.)
        places.assign(static_cast<std::size_t>(slots) + 2, 0);
        rows.stretches.clear();
        rows.pieces.clear();
        rows.slots.clear();
        for (std::uint32_t at = rows.offset[batch]; at < rows.offset[batch + 1]; ++at) {
            const RowPart& part = begin_[rows.parts[at]];
            std::uint32_t begin = part.begin, end = part.end;
            const auto& place = rows.eyes[rows.parts[at]];
            const Vec3 eye(place[0], place[1], place[2]);
            narrow(depth_of(eye), least, past, begin, end);
            if (begin >= end) {
                continue;
            }
            poll_after(end - begin);
            if (!seen(live, eye + static_cast<double>(begin - part.begin) * view_.step_i, end - begin)) {
                continue;
            }
            for_each_run(runs_, part, begin, end, [&](const Run& run, std::uint32_t run_begin, std::uint32_t run_end) {
                // Numbers do not depend on where batches begin.
                const std::uint32_t start = std::max(run.begin, part.begin);
                const auto stretch = static_cast<std::uint32_t>(rows.stretches.size());
                bool any = false;
                const Vec3 first = eye_of(part.row, start);
                for (std::uint32_t i = run_begin; i < run_end; i += fed_together) {
                    const std::uint32_t count = std::min(fed_together, run_end - i);
                    if (seen(live, first + static_cast<double>(i - start) * view_.step_i, count)) {
                        rows.pieces.push_back({stretch, i - start, count});
                        any = true;
                    }
                }
                if (any) {
                    const Vec3 unit = unit_at(first);
                    rows.stretches.push_back({part.row,
                                              row_begin(part.row) + start,
                                              start,
                                              depth_of(first),
                                              step_,
                                              {unit.x, unit.y, unit.z}});
                }
            });
        }
        // Samples in loops that the compiler makes vectors of.
        rows.slots.resize(rows.pieces.size() * fed_together);
        std::int32_t* slot = rows.slots.data();
        for (const RowBatches::Piece& piece : rows.pieces) {
            const RowBatches::Stretch& stretch = rows.stretches[piece.stretch];
            // (Of what is beyond the piece too.)
            for (std::uint32_t i = 0; i < fed_together; ++i) {
                const auto along = static_cast<double>(static_cast<std::int32_t>(piece.from + i));
                const double first = first_of(stretch.depth + along * stretch.step) - least;
                slot[i] = static_cast<std::int32_t>(first < 0.0 ? past - least : std::min(first, past - least));
            }
            for (std::uint32_t i = 0; i < piece.count; ++i) {
                ++places[static_cast<std::size_t>(slot[i]) + 1];
            }
            slot += fed_together;
            poll_after(piece.count);
        }
        const std::size_t before = kernels_.sections.size();
        for (std::size_t start = 1; start < places.size(); ++start) {
            places[start] += places[start - 1];
        }
        const std::size_t kept = places[static_cast<std::size_t>(slots)];
        kernels_.sections.resize(before + places.back());
        if (sources_.empty()) {
            std::visit(
                [&](const auto& data) {
                    write(OneLattice<T, decltype(data.data())>{reader_, data.data()}, least, before);
                },
                view_.field->samples());
        } else {
            kernels_.values.resize(kernels_.sections.size() * kernels_.fields);
            write(SeveralLattices<T>{sources_, kernels_, {}}, least, before);
            kernels_.values.resize((before + kept) * kernels_.fields);
        }
        kernels_.sections.resize(before + kept);
    }

    /// Leaves out samples of a part of a row that begin on no slice least <= n < past; some of them may stay.
    HWY_INLINE void narrow(double depth, double least, double past, std::uint32_t& begin, std::uint32_t& end) const {
        if (!(std::abs(step_) > 1e-9)) {
            return;
        }
        // Samples begin on the slice behind depth - reach: a whole one less, and one more for rounding.
        double from = (least - 2.0 + reach_ - depth) * per_step_, to = (past + 1.0 + reach_ - depth) * per_step_;
        if (from > to) {
            std::swap(from, to);
        }
        const double count = static_cast<double>(end - begin);
        // Samples that begin in front of slice 0 begin there.
        from = least <= 0.0 && step_ > 0.0 ? 0.0 : from;
        to = least <= 0.0 && step_ < 0.0 ? count : to;
        from = std::min(std::max(std::floor(from), 0.0), count);
        to = std::min(std::max(std::ceil(to) + 1.0, 0.0), count);
        end = begin + static_cast<std::uint32_t>(to);
        begin += static_cast<std::uint32_t>(from);
    }

    /// Behind the first `before` sections.
    template <class Values>
    void write(Values source, double least, std::size_t before) {
        Section<T>* sections = kernels_.sections.data() + before;
        const RowBatches& rows = kernels_.rows;
        const double per_slice = frame_.slice_spacing * per_half_depth_;
        const auto origin = static_cast<std::int32_t>(least);
        const std::int32_t* slot = rows.slots.data();
        for (const RowBatches::Piece& piece : rows.pieces) {
            const RowBatches::Stretch& stretch = rows.stretches[piece.stretch];
            // Numbers first; then each to its place.
            T a1[fed_together], a2[fed_together], s[fed_together], value[fed_together] = {};
            source.read(stretch, piece, value);
            for (std::uint32_t i = 0; i < fed_together; ++i) {
                const auto along = static_cast<double>(static_cast<std::int32_t>(piece.from + i));
                const double first = static_cast<double>(slot[i]) + least;
                a1[i] = static_cast<T>(stretch.unit[0] + along * step_unit_.x + first * step_slice_.x);
                a2[i] = static_cast<T>(stretch.unit[1] + along * step_unit_.y + first * step_slice_.y);
                s[i] = static_cast<T>((stretch.depth + along * stretch.step - first) * per_slice);
            }
            for (std::uint32_t i = 0; i < piece.count; ++i) {
                const std::uint32_t at = kernels_.places[static_cast<std::size_t>(slot[i])]++;
                source.put(before + at, i);
                Section<T>& section = sections[at];
                section.a1 = a1[i];
                section.a2 = a2[i];
                section.s = s[i];
                section.value = value[i];
                section.first = slot[i] + origin;
            }
            slot += fed_together;
            poll_after(piece.count);
        }
    }

    /// With the pixels that each can touch, all at once; sorted afterwards.
    void one_by_one() {
        const double spacing = frame_.slice_spacing;
        const T weight = static_cast<T>(view_.weight_scale);
        for_each_stretch([&](std::size_t sample, const Vec3& eye, std::uint32_t count) {
            const double start = depth_of(eye);
            const Vec3 unit = unit_at(eye);
            T values[fed_together];
            for (std::uint32_t i = 0; i < count; ++i) {
                const std::uint32_t in_piece = i % fed_together;
                if (in_piece == 0) {
                    reader_.read(sample + i, std::min(fed_together, count - i), values);
                }
                const auto along = static_cast<double>(i);
                const double depth = start + along * step_;
                const double first = first_of(depth), last = last_of(depth);
                if (!(first <= last)) {
                    continue;
                }
                Section<T> section;
                SectionExtra<T> extra;
                section.first = static_cast<std::int32_t>(first);
                extra.last = static_cast<std::int32_t>(last);
                const Vec3 place_eye = eye + along * view_.step_i;
                if (view_.unfiltered) {
                    add_filtered(place_eye, values[in_piece], section, extra);
                    continue;
                }
                if (!place(box_of(place_eye, first, last, view_.extent_x, view_.extent_y), tile_, extra)) {
                    continue;
                }
                extra.weight = weight;
                section.a1 = static_cast<T>(unit.x + along * step_unit_.x + first * step_slice_.x);
                section.a2 = static_cast<T>(unit.y + along * step_unit_.y + first * step_slice_.y);
                section.s = static_cast<T>((depth - first) * spacing * per_half_depth_);
                section.value = values[in_piece];
                kernels_.unsorted.push_back(section);
                kernels_.unsorted_extras.push_back(extra);
            }
        });
        kernels_.sort();
    }

    /// In perspective, a kernel with a shape of its own.
    void add_filtered(const Vec3& eye, T value, Section<T>& section, SectionExtra<T>& extra) {
        const WidenedShape shape =
            widened(*view_.unfiltered, semi_axes_, filter_width(frame_, view_.field->kernel(), -eye.z));
        const LatticeSection own = section_of(shape.rows);
        if (!place(box_of(eye, section.first, extra.last, own.extent_x, own.extent_y), tile_, extra)) {
            return;
        }
        const RowBasis basis(own.to_unit * glm::dvec2(frame_.pixel, 0.0), own.to_unit * glm::dvec2(0.0, -frame_.pixel));
        const double depth = frame_.depth_of(section.first), step = frame_.slice_spacing / own.half_depth;
        const double s = (-eye.z - depth) / own.half_depth;
        const glm::dvec2 plane = own.to_unit * (depth * origin_ - glm::dvec2(eye.x, eye.y)) - s * own.shear;
        const glm::dvec2 drift = own.to_unit * (frame_.slice_spacing * origin_) + step * own.shear;
        set_place(basis, plane, s, section);
        section.value = static_cast<T>(static_cast<double>(value) * shape.amplitude);
        extra.weight = static_cast<T>(std::max(view_.weight_scale * shape.amplitude, least_drawn_weight));
        kernels_.unsorted.push_back(section);
        kernels_.unsorted_extras.push_back(extra);
        kernels_.unsorted_shapes.push_back(row_shape<T>(basis, drift, step));
    }

    /// What samples on a line between two places can touch.
    [[nodiscard]] HWY_INLINE SheetBox box_between(const Vec3& a, const Vec3& b) const {
        if (!perspective_) {
            const double x = (a.x - origin_.x) * per_pixel_, y = (origin_.y - a.y) * per_pixel_;
            const double to_x = (b.x - origin_.x) * per_pixel_, to_y = (origin_.y - b.y) * per_pixel_;
            return {std::min(x, to_x) - half_x_, std::max(x, to_x) + half_x_, std::min(y, to_y) - half_y_,
                    std::max(y, to_y) + half_y_};
        }
        const double near = std::max(std::min(-a.z, -b.z) - view_.half_depth, frame_.first_depth - view_.slab_half);
        const double far = std::max(near, std::max(-a.z, -b.z) + view_.half_depth);
        return in_perspective(near, far, std::min(a.x, b.x) - view_.extent_x, std::max(a.x, b.x) + view_.extent_x,
                              std::min(-a.y, -b.y) - view_.extent_y, std::max(-a.y, -b.y) + view_.extent_y);
    }

    /// What is between edges in eye space and between two depths.
    [[nodiscard]] SheetBox in_perspective(double near, double far, double left, double right, double top,
                                          double bottom) const {
        if (near <= 1e-9 * frame_.slice_spacing) {
            return {0.0, tile_.width + 1.0, 0.0, tile_.height + 1.0};
        }
        // (c +- e) / t is monotonic in t, so that the extremes lie at the nearest or farthest depth.
        const auto lowest = [&](double edge) { return std::min(edge / near, edge / far); };
        const auto highest = [&](double edge) { return std::max(edge / near, edge / far); };
        return {(lowest(left) - origin_.x) / frame_.pixel, (highest(right) - origin_.x) / frame_.pixel,
                (origin_.y + lowest(top)) / frame_.pixel, (origin_.y + highest(bottom)) / frame_.pixel};
    }

    [[nodiscard]] SheetBox box_of(const Vec3& eye, double first, double last, double extent_x, double extent_y) const {
        if (!perspective_) {
            const double x = (eye.x - origin_.x) / frame_.pixel, y = (origin_.y - eye.y) / frame_.pixel;
            const double half_x = extent_x / frame_.pixel, half_y = extent_y / frame_.pixel;
            return {x - half_x, x + half_x, y - half_y, y + half_y};
        }
        const double spacing = frame_.slice_spacing;
        const double near = std::max(-eye.z - view_.half_depth, frame_.first_depth + first * spacing - view_.slab_half);
        const double far =
            std::max(near, std::min(-eye.z + view_.half_depth, frame_.first_depth + last * spacing + view_.slab_half));
        return in_perspective(near, far, eye.x - extent_x, eye.x + extent_x, -eye.y - extent_y, -eye.y + extent_y);
    }

    const FieldView& view_;
    const VisibleRuns& runs_;
    const Frame& frame_;
    bool slab_;
    const RowPart* begin_;
    const RowPart* end_;
    const TileShape& tile_;
    TileKernels<T>& kernels_;
    bool perspective_;
    RowBasis basis_;
    glm::dvec2 origin_;
    double half_x_, half_y_, per_pixel_;
    double per_spacing_, per_half_depth_, reach_, step_, per_step_, last_slice_;
    OwnPlaces own_;
    SampleReader<T> reader_;
    std::vector<LatticeSource<T>> sources_; ///< none, or of this lattice and of those beside
    Vec3 semi_axes_ = view_.field->kernel_axes().lengths;
    glm::dvec2 lean_; ///< B's rows of x and of y times that of z
    /// The outermost rays of the tile's own part in perspective: x / depth and -y / depth. The same numbers in tiles
    /// side by side.
    glm::dvec2 own_rays_x_{0.0}, own_rays_y_{0.0};
    Vec3 step_slice_{0.0}, step_unit_{0.0};
    bool at_once_ = false;            ///< one batch, of all slices
    double least_ = 0.0, past_ = 1.0; ///< slices that kernels begin on
    std::int64_t length_ = 1;         ///< slices of a batch
    std::int64_t batches_ = 1, batch_ = 0;
    std::size_t looked_at_ = 0;
};

template <class T>
void feed_rows(const LatticeRows& rows, const TileShape& tile, TileKernels<T>& kernels) {
    RowFeed<T> feed(rows, tile, kernels);
    feed.begin();
    while (!feed.ended()) {
        feed.feed(Live(tile));
    }
}

} // namespace sheetsplat::backend_cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif // SHEETSPLAT_CPU_FEED_ROWS_INL
