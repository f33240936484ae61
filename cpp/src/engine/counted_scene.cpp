#include "counted_scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <glm/geometric.hpp>

#include "facts/field_survey.hpp"
#include "index/visible_runs.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// The farthest that stencils reach, in slice distances along a ray: of slabs, second order and crossings, and of lines
/// towards lights.
constexpr double stencil_in_slices = 5.0;
/// How much a filter may raise sums over a lattice, in perspective.
constexpr double filter_gain = 4.0;
/// The farthest that a point can be from the samples around it, in sample distances: of Cartesian lattices, and of BCC
/// lattices, whose distances count in a / sqrt 2.
constexpr double farthest_cartesian = 0.8660254037844387, farthest_bcc = 0.7905694150420949;

/// A field as one that ends nowhere, which it counts as beside fields that end elsewhere; null where it is one.
std::shared_ptr<const Field> without_end(const Field& field) {
    if (const RegularField* lattice = as_regular(&field)) {
        return lattice->domain() || lattice->base() != 0.0 ? lattice->without_end() : nullptr;
    }
    return field.domain() ? as_ellipsoids(&field)->without_end() : nullptr;
}

/// Whether kernels reach every point of a lattice's domain, once samples are mirrored.
bool fills(const Field& field) {
    const RegularField* lattice = as_regular(&field);
    const double farthest =
        lattice != nullptr && lattice->lattice() == Lattice::bcc ? farthest_bcc : farthest_cartesian;
    return lattice != nullptr && !lattice->has_holes() && lattice->options().radius > farthest;
}

double sum_of(const std::vector<double>& numbers) { return std::accumulate(numbers.begin(), numbers.end(), 0.0); }

TransferFunction counted_from(const TransferFunction& function, double base) {
    std::vector<TransferPoint> points = function.points();
    for (TransferPoint& point : points) {
        point.value -= base;
    }
    return TransferFunction(std::move(points));
}

/// Cuts at the faces of a domain too, which come last.
void end_at(const std::optional<Parallelepiped>& domain, Clip& clip) {
    const Clip end{{}, domain};
    clip = {clip.half_spaces(), {}};
    for (const Clip::Plane& face : end.half_spaces()) {
        clip.planes.push_back(face);
    }
}

/// The largest distance, in world units, that a point which shows may lie from kernels that matter to it.
double reach_of(const Scene& scene, const Field& field, const Camera& camera, Size size) {
    const Box box = field.supports_world();
    double deepest = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
        const Vec3 point((corner & 1) != 0 ? box.upper.x : box.lower.x, (corner & 2) != 0 ? box.upper.y : box.lower.y,
                         (corner & 4) != 0 ? box.upper.z : box.lower.z);
        deepest = std::max(deepest, -camera.to_eye(point).z);
    }
    const bool perspective = camera.projection() == Projection::perspective;
    const double pixel = 2.0 * camera.half_height() / size.height;
    const double width = pixel * (perspective ? deepest : 1.0);
    // The ray that runs sideways most: with the camera's shift.
    const double slope_x = (0.5 * size.width + std::abs(camera.shift().x) * size.height) * pixel;
    const double slope_y = (0.5 + std::abs(camera.shift().y)) * size.height * pixel;
    const double slant = perspective ? std::hypot(1.0, std::hypot(slope_x, slope_y)) : 1.0;
    const double spacing = scene.slice_distance();
    const double stencil = stencil_in_slices * spacing * slant + width;
    return stencil + (scene.filter == Filter::ewa ? field.kernel().deviations() * std::max(width, spacing) : 0.0);
}

/// Lattices that end in one place, with kernels that reach as far across the ends.
bool ends_alike(const Field& a, const Field& b) {
    const RegularField* const of_a = as_regular(&a);
    const RegularField* const of_b = as_regular(&b);
    return of_a != nullptr && of_b != nullptr && a.domain() == b.domain() && of_a->steps() == of_b->steps() &&
           of_a->lattice() == of_b->lattice() && of_a->options().radius == of_b->options().radius;
}

} // namespace

CountedFields::Entry& CountedFields::entry_of(const std::shared_ptr<const Field>& field) {
    for (const auto& entry : entries_) {
        if (entry->field.lock() == field) {
            return *entry;
        }
    }
    entries_.push_back(std::make_unique<Entry>());
    entries_.back()->field = field;
    return *entries_.back();
}

std::string CountedFields::why_shown(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs) {
    if (outputs.coverage) {
        return "coverage counts all that kernels reach inside the volume";
    }
    std::size_t number = 0;
    const Field* shown = nullptr;
    for (const Group& group : scene.groups()) {
        const std::size_t own = number++;
        if (group.use.role == GroupRole::colors) {
            // What is looked at below, of what takes the colours, holds for lattices that lie like it alone.
            if (scene.fields[group.first]->domain() && !ends_alike(*scene.fields[group.first], *shown)) {
                return "colours are those of a field that ends";
            }
            continue;
        }
        shown = scene.fields[group.first].get();
        if (!scene.fields[group.first]->domain() || !is_classified(group)) {
            continue;
        }
        if (as_regular(scene.fields[group.first].get()) == nullptr) {
            return "kernels reach across the faces of the periodic box";
        }
        if (group.last - group.first > 1) {
            return "several fields add up at the volumes' boundary";
        }
        const std::shared_ptr<const Field>& field = scene.fields[group.first];
        const RegularField& lattice = *as_regular(field.get());
        const bool bcc = lattice.lattice() == Lattice::bcc;
        // Layers across the ends: of BCC lattices two for each edge.
        const double nearest = lattice.default_slice_spacing();
        const double radius = lattice.options().radius * (bcc ? std::sqrt(2.0) : 1.0);
        // What mirrored kernels add to reaches a radius into the volume; kernels that reach there, one more.
        const double layers = 2.0 * std::sqrt(3.0) * radius + reach_of(scene, lattice, camera, size) / nearest;
        const auto most = static_cast<double>(std::max({lattice.shape()[0], lattice.shape()[1], lattice.shape()[2]}));
        // Rounded up, so that a camera that moves needs no new look at the samples.
        const double wanted = std::min(std::exp2(std::ceil(std::log2(std::max(layers, 1.0)))), most);
        const auto samples = static_cast<std::size_t>(wanted);
        Entry& entry = entry_of(field);
        auto range = entry.ranges.find(samples);
        if (range == entry.ranges.end()) {
            range = entry.ranges.emplace(samples, lattice.range_near_ends(samples)).first;
        }
        const auto [low, high] = range->second;
        if (is_scalar(scene.mode)) {
            if (traits_of(scene.mode).integrates && lattice.base() == 0.0 && low == 0.0 && high == 0.0) {
                continue;
            }
            return "the mode counts or sums what lies inside the volume";
        }
        if (is_label(group)) {
            if (high > 0.0) {
                return "a label reaches the volume's boundary";
            }
            continue;
        }
        VisibilityQuery query;
        query.transfer_function = group.transfer_function;
        query.isosurface = shows_surfaces(scene.mode);
        query.cubic = scene.second_order;
        for (const IsoValue& iso : iso_values_of(scene, own)) {
            query.iso_values.push_back(iso.value);
        }
        const VisibleFrom from = visible_from(query);
        const double gain = scene.filter == Filter::ewa ? filter_gain : 0.0;
        auto known = entry.weights.find(gain);
        if (known == entry.weights.end()) {
            known = entry.weights.emplace(gain, largest_weight(lattice, gain)).first;
        }
        const double weight = known->second;
        const bool at_base = !query.isosurface && shows_at_base(group);
        if (at_base || high * weight >= from.above || -low * weight >= from.below) {
            return "something shows at the volume's boundary";
        }
    }
    return {};
}

Scene CountedFields::counted(const Scene& scene, const Camera& camera, Size size, const Outputs& outputs) {
    Scene drawn = scene;
    drawn.counted.emplace();
    Counted& counted = *drawn.counted;
    counted.clip = scene.clip;
    const std::vector<Group> groups = scene.groups();
    std::vector<std::optional<Parallelepiped>> ends;
    for (const Group& group : groups) {
        std::optional<Parallelepiped> end = scene.fields[group.first]->domain();
        bool differ = false;
        for (std::size_t field = group.first; field < group.last; ++field) {
            differ = differ || end != scene.fields[field]->domain();
        }
        double base = 0.0;
        for (std::size_t field = group.first; field < group.last; ++field) {
            std::shared_ptr<const Field>& own = drawn.fields[field];
            if (differ) {
                Entry& entry = entry_of(own);
                entry.endless = entry.endless ? entry.endless : without_end(*own);
                own = entry.endless ? entry.endless : own;
            }
            base += own->base();
        }
        counted.bases.push_back(base);
        ends.push_back(differ ? std::nullopt : end);
    }
    if (counted.bases.front() != 0.0) {
        drawn.transfer_function = counted_from(scene.transfer_function, counted.bases.front());
    }
    for (std::size_t group = 0; group < drawn.later_groups.size(); ++group) {
        const double base = counted.bases[group + 1];
        if (base != 0.0) {
            TransferFunction& function = drawn.later_groups[group].transfer_function;
            function = counted_from(function, base);
        }
    }
    bool any = false, differ = false;
    for (const std::optional<Parallelepiped>& end : ends) {
        any = any || end;
        differ = differ || end != ends.front();
    }
    if (scene.part) {
        counted.mirrored = scene.part->domain.has_value();
        counted.filled = scene.part->filled;
        end_at(scene.part->domain, drawn.clip);
    } else if (any) {
        counted.reason = why_shown(drawn, camera, size, outputs);
        counted.mirrored = !counted.reason.empty();
    }
    if (counted.mirrored && any) {
        counted.filled = !differ;
        for (std::size_t group = 0; group < groups.size(); ++group) {
            bool filled = false;
            for (std::size_t field = groups[group].first; field < groups[group].last && ends[group]; ++field) {
                std::shared_ptr<const Field>& own = drawn.fields[field];
                filled = filled || fills(*own);
                if (as_regular(own.get()) == nullptr) {
                    continue;
                }
                Entry& entry = entry_of(own);
                entry.mirrored = entry.mirrored ? entry.mirrored : as_regular(own.get())->with_mirrored();
                own = entry.mirrored;
            }
            counted.filled = counted.filled && filled;
        }
        if (differ) {
            counted.ends = std::move(ends);
        } else {
            end_at(ends.front(), drawn.clip);
        }
    }
    // An x-ray sums what counts: a base, and the quotients beside missing samples, are not there everywhere.
    const bool sums_all = counted.ends.empty() ? sum_of(counted.bases) == 0.0
                                               : std::all_of(counted.bases.begin(), counted.bases.end(),
                                                             [](double base) { return base == 0.0; });
    const bool thin = std::any_of(drawn.fields.begin(), drawn.fields.end(),
                                  [](const auto& field) { return field->least_weight() > 0.0; });
    if (traits_of(scene.mode).integrates && (!sums_all || thin)) {
        drawn.mode = Mode::average;
        counted.counts = true;
    }
    return drawn;
}

std::shared_ptr<const Field> CountedFields::source_of(const std::shared_ptr<const Field>& drawn) const {
    for (const auto& entry : entries_) {
        if (drawn != nullptr && (entry->mirrored == drawn || entry->endless == drawn)) {
            return entry->field.lock();
        }
    }
    return drawn;
}

std::vector<std::shared_ptr<const Field>> CountedFields::keep(const std::vector<std::shared_ptr<const Field>>& fields) {
    keep_fields(entries_, fields, [](const Entry&, const Field&) { return false; });
    std::vector<std::shared_ptr<const Field>> all = fields;
    for (const auto& entry : entries_) {
        for (const std::shared_ptr<const Field>& form :
             {std::shared_ptr<const Field>(entry->mirrored), entry->endless}) {
            if (form != nullptr) {
                all.push_back(form);
            }
        }
    }
    return all;
}

void add_bases(const Scene& drawn, const Scene& asked, const Camera& camera, Image& image) {
    // (Groups that end in different places have theirs already.)
    const double base = drawn.counted->ends.empty() ? sum_of(drawn.counted->bases) : 0.0;
    if ((base == 0.0 && !drawn.counted->counts) || !is_scalar(asked.mode)) {
        return;
    }
    const Size size = image.size;
    const double pixel = 2.0 * camera.half_height() / size.height;
    const bool perspective = camera.projection() == Projection::perspective;
    const double axis_x = 0.5 * size.width - camera.shift().x * size.height;
    const double axis_y = 0.5 * size.height + camera.shift().y * size.height;
    for (int row = 0; row < size.height; ++row) {
        for (int column = 0; column < size.width; ++column) {
            const std::size_t at =
                static_cast<std::size_t>(row) * static_cast<std::size_t>(size.width) + static_cast<std::size_t>(column);
            double value = static_cast<double>(image.scalar[at]) + base;
            if (drawn.counted->counts) {
                const double slant =
                    perspective
                        ? std::hypot(1.0, std::hypot((column + 0.5 - axis_x) * pixel, (axis_y - row - 0.5) * pixel))
                        : 1.0;
                const auto count = static_cast<double>(image.counts[at]);
                value = count > 0.0 ? value * count * drawn.slice_distance() * slant : 0.0;
            }
            image.scalar[at] = static_cast<float>(value);
        }
    }
    if (drawn.counted->counts) {
        image.counts.clear();
    }
}

} // namespace sheetsplat
