#include "light/grids.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>

#include "light/surface_lines.hpp"
#include "plan/limits_common.hpp"
#include "scene/mode_rules.hpp"

namespace sheetsplat {

namespace {

/// Grids are this much coarser until they fit.
constexpr double coarser = 1.25;
/// Elements of a grid that shows all kernels in the radius of the smallest one.
constexpr double least_radius_of_cells = 2.0;
/// Of a step or a slice distance: what only touches does not depend on rounding.
constexpr double touching = 1e-6;

double least_semi_axis(const Field& field) {
    const EllipsoidField* ellipsoids = as_ellipsoids(&field);
    if (ellipsoids != nullptr) {
        return ellipsoids->scale_range()[0];
    }
    return as_regular(&field)->kernel_axes().least();
}

/// Of the range of a group's values: where less is opaque in one piece, what shows is thinner than kernels are, sheets
/// or tips that lie between elements.
constexpr double narrow_share = 0.05;

/// The least length of a range of values that is opaque in one piece, of those that occur; infinite where none is.
double narrowest_opaque(const TransferFunction& function, double lower, double upper) {
    double least = std::numeric_limits<double>::infinity();
    double begin = std::numeric_limits<double>::quiet_NaN(); // of the piece, none: NaN
    const auto end_at = [&](double end) {
        const double from = std::max(begin, lower), to = std::min(end, upper);
        if (from <= to) {
            least = std::min(least, to - from);
        }
        begin = std::numeric_limits<double>::quiet_NaN();
    };
    const std::vector<TransferPoint>& points = function.points();
    if (points.front().opacity > 0.0) {
        begin = -std::numeric_limits<double>::infinity();
    }
    for (std::size_t n = 0; n + 1 < points.size(); ++n) {
        const bool opaque = points[n].opacity > 0.0 || points[n + 1].opacity > 0.0;
        if (opaque && std::isnan(begin)) {
            begin = points[n].value;
        } else if (!opaque && !std::isnan(begin)) {
            end_at(points[n].value);
        }
        if (points[n + 1].opacity == 0.0 && !std::isnan(begin)) {
            end_at(points[n + 1].value);
        }
    }
    if (points.back().opacity > 0.0) {
        begin = std::isnan(begin) ? points.back().value : begin;
        end_at(std::numeric_limits<double>::infinity());
    }
    return least;
}

bool is_narrow(const Scene& scene, const Group& group) {
    double lower = 0.0, upper = 0.0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        const auto [low, high] = scene.fields[field]->value_range();
        lower += std::min(low, 0.0);
        upper += std::max(high, 0.0);
    }
    return narrowest_opaque(*group.transfer_function, lower, upper) < narrow_share * (upper - lower);
}

/// Whether matter may be thinner than kernels are: opaque in a narrow range of rho, or cut.
bool is_cut(const Scene& scene) {
    const std::vector<Group> groups = scene.groups();
    return !scene.clip.empty() || (scene.counted && !scene.counted->ends.empty()) || shows_narrowly(scene) ||
           std::any_of(groups.begin(), groups.end(),
                       [](const Group& group) { return group.transfer_function->has_steps(); });
}

/// Width of a pixel where the box of all supports is nearest. (The nearest kernel may be farther, which only those who
/// have all of them know.)
double smallest_pixel(const Frame& frame, const Camera& camera, const Box& supports) {
    if (frame.projection == Projection::orthographic) {
        return frame.pixel;
    }
    double nearest = std::numeric_limits<double>::infinity();
    for (int corner = 0; corner < 8; ++corner) {
        const Vec3 at((corner & 1) != 0 ? supports.upper.x : supports.lower.x,
                      (corner & 2) != 0 ? supports.upper.y : supports.lower.y,
                      (corner & 4) != 0 ? supports.upper.z : supports.lower.z);
        nearest = std::min(nearest, -camera.to_eye(at).z);
    }
    return frame.pixel * std::max(nearest, frame.near);
}

/// Step of the grids on which light is kept: a slice distance, or twice, four times ... as much where pixels are
/// larger. Few different values, so that a camera that moves a little closer can use the same volumes.
double light_step(const Frame& frame, double pixel) {
    const double pixels = std::clamp(pixel / frame.slice_spacing, 1.0, 1e6);
    return frame.slice_spacing * std::exp2(std::floor(std::log2(pixels)));
}

/// Grid step of ambient occlusion, which is a mean over directions and may be coarser: a quarter of its radius, up to
/// two slice distances or half of the step that pixels call for, `light`.
double open_step(const Frame& frame, double steps, double light) {
    const double most = std::max(2.0, 0.5 * light / frame.slice_spacing);
    return frame.slice_spacing * std::exp2(std::floor(std::log2(std::clamp(0.25 * steps, 1.0, most))));
}

/// Grid step of rho in mode isosurface, in slice distances: half of one moves the edges of shadows by a few hundredths
/// of a sample distance.
constexpr double scalar_step = 0.5;

/// The box of all supports.
Box supports_of(const Scene& scene, const Reach& reach) {
    if (scene.part) {
        return scene.part->supports;
    }
    const Vec3 middle = scene.centres_world().centre();
    Box all;
    for (int axis = 0; axis < 3; ++axis) {
        Vec3 direction(0.0);
        direction[axis] = 1.0;
        double lower = std::numeric_limits<double>::infinity(), upper = -lower;
        for (const auto& field : scene.fields) {
            if (field->size() > 0) {
                const auto [behind, ahead] =
                    reach ? reach(*field, middle, direction) : field->reach_along(middle, direction);
                lower = std::min(lower, behind);
                upper = std::max(upper, ahead);
            }
        }
        all.lower[axis] = middle[axis] + lower;
        all.upper[axis] = middle[axis] + upper;
    }
    return all;
}

/// A grid of all supports with elements of about `wanted`, or as many as fit. Along z these are whole slice distances
/// (steps_together of them are one); cubes: as across it, a slice each.
LightGrid grid_around(const Box& supports, const LitView& view, double wanted, double most_elements,
                      bool cubes = false) {
    Scene scene = view.scene;
    LightGrid grid;
    grid.wanted = grid.step = wanted;
    const Vec3 lengths = supports.extent();
    // Beyond an edge lies an element that nothing reaches: what is outside of the grid has its number.
    const auto count = [](double length, double pitch) { return std::ceil(length / pitch - touching) + 3.0; };
    for (;; grid.step *= coarser) {
        grid.spacing = cubes ? grid.step : steps_together(scene) * scene.slice_distance();
        grid.every = static_cast<int>(std::clamp(std::round(grid.step / grid.spacing), 1.0, 1e6));
        const double wide = count(lengths.x, grid.step), high = count(lengths.y, grid.step);
        const double deep = count(lengths.z, grid.spacing * grid.every);
        if (wide * high * deep <= most_elements && wide < 16384.0 && high < 16384.0) {
            grid.size = {static_cast<int>(wide), static_cast<int>(high)};
            break;
        }
    }
    const Vec3 middle = supports.centre();
    grid.first.x = middle.x - 0.5 * (grid.size.width - 1) * grid.step;
    grid.first.y = middle.y + 0.5 * (grid.size.height - 1) * grid.step;
    // The slices of a view along z, of which those that only touch a support are there.
    Frame widened;
    widened.slice_spacing = grid.spacing;
    double longer = touching * grid.spacing;
    for (const auto& field : scene.fields) {
        longer = std::max(longer, view.plan.filter ? filter_width(widened, field->kernel(), 0.0).along : 0.0);
    }
    const Camera camera = camera_along_z(middle, grid.step * grid.size.height);
    constexpr double everywhere = std::numeric_limits<double>::infinity();
    Part whole{Box{Vec3(-everywhere), Vec3(everywhere)}, scene.centres_world(), {}};
    whole.depths = {middle.z - supports.upper.z - longer, middle.z - supports.lower.z + longer};
    scene.reference_length = scene.reference_distance();
    scene.slice_spacing = grid.spacing;
    scene.part = whole;
    const Frame frame = make_frame(scene, camera, grid.size);
    grid.first.z = middle.z - frame.first_depth;
    grid.slices = frame.slices;
    return grid;
}

/// What of a grid lies in a cell. A face that two cells share divides elements and slices alike for both.
LightCut cut_of(const LightGrid& grid, const Box& cell) {
    // The first element at or above a face, or below one, of a row that rises, or falls.
    const auto rising = [](double start, double step, double face, double count) {
        return std::clamp(std::ceil((face - start) / step), 0.0, count);
    };
    const auto falling = [](double start, double step, double face, double count) {
        return std::clamp(std::floor((start - face) / step) + 1.0, 0.0, count);
    };
    const double wide = grid.size.width, high = grid.size.height;
    const double x0 = rising(grid.first.x, grid.step, cell.lower.x, wide);
    const double x1 = rising(grid.first.x, grid.step, cell.upper.x, wide);
    const double y0 = falling(grid.first.y, grid.step, cell.upper.y, high);
    const double y1 = falling(grid.first.y, grid.step, cell.lower.y, high);
    const auto slices = static_cast<double>(grid.slices);
    const double z0 = falling(grid.first.z, grid.spacing, cell.upper.z, slices);
    const double z1 = falling(grid.first.z, grid.spacing, cell.lower.z, slices);
    LightCut cut;
    cut.first = {static_cast<int>(x0), static_cast<int>(y0)};
    cut.size = {static_cast<int>(x1 - x0), static_cast<int>(y1 - y0)};
    if (z0 < z1) {
        const double every = grid.every;
        const double first = std::floor(z0 / every) * every, last = std::min(std::ceil(z1 / every) * every, slices);
        cut.first_slice = static_cast<std::int64_t>(first);
        cut.slices = static_cast<std::int64_t>(last - first);
        cut.upper = z0 > first ? grid.first.z - (z0 - 0.5) * grid.spacing : cut.upper;
        cut.lower = z1 < last ? grid.first.z - (z1 - 0.5) * grid.spacing : cut.lower;
    }
    return cut;
}

/// Sets to 0 what of a cut's values, one a slice, lies outside of a cell.
void keep_elements(const LightGrid& grid, const LightCut& cut, const Parallelepiped& cell, std::vector<float>& values) {
    float* value = values.data();
    for (std::int64_t z = 0; z < cut.slices; ++z) {
        for (int y = 0; y < cut.size.height; ++y) {
            for (int x = 0; x < cut.size.width; ++x, ++value) {
                const Vec3 at =
                    cell.to_box * Vec3(grid.first.x + grid.step * (cut.first[0] + x),
                                       grid.first.y - grid.step * (cut.first[1] + y),
                                       grid.first.z - grid.spacing * static_cast<double>(cut.first_slice + z));
                const bool held =
                    glm::all(glm::lessThanEqual(cell.box.lower, at)) && glm::all(glm::lessThan(at, cell.box.upper));
                *value = held ? *value : 0.0F;
            }
        }
    }
}

LightCut all_of(const LightGrid& grid) {
    LightCut all;
    all.size = grid.size;
    all.slices = grid.slices;
    return all;
}

} // namespace

Camera camera_along_z(const Vec3& eye, double height) {
    return Camera::orthographic(eye, eye - Vec3(0.0, 0.0, 1.0), Vec3(0.0, 1.0, 0.0), height);
}

bool shows_narrowly(const Scene& scene) {
    const std::vector<Group> groups = scene.groups();
    return is_composited(scene.mode) &&
           std::any_of(groups.begin(), groups.end(), [&scene](const Group& group) { return is_narrow(scene, group); });
}

double steps_together(const Scene& scene) {
    constexpr double steps_of_kernel = 32.0;
    return std::max(1.0, std::floor(scene.default_slice_spacing() / (steps_of_kernel * scene.slice_distance())));
}

bool shows_kernels(const Scene& scene, double step) {
    return std::all_of(scene.fields.begin(), scene.fields.end(), [step](const auto& field) {
        return field->size() == 0 || least_semi_axis(*field) >= least_radius_of_cells * step;
    });
}

bool shows_kernels(const Scene& scene, const LightVolume& grid) {
    double step = 0.0;
    for (const Vec3& per_step : grid.per_step) {
        step = std::max(step, 1.0 / glm::length(per_step));
    }
    return shows_kernels(scene, step);
}

bool shows_matter(const Scene& scene, const DrawPlan& plan, const LightVolume& absorption) {
    return !plan.filter && shows_kernels(scene, absorption) && !is_cut(scene);
}

LightPlan make_light_plan(const LitView& view, const Reach& reach) {
    const Scene& scene = view.scene;
    const Frame& frame = view.frame;
    LightPlan light;
    light.slice_spacing = frame.slice_spacing;
    light.surfaces = shows_surfaces(view.plan.mode);
    const std::size_t volumes =
        light.surfaces ? scene.groups().size() : (view.plan.shadows ? scene.lights.size() : 0) + 2;
    const double elements = std::min(static_cast<double>(most_light_elements),
                                     static_cast<double>(most_light_elements_of_all) / static_cast<double>(volumes));
    if (frame.slices == 0) {
        return light;
    }
    const Box supports = supports_of(scene, reach);
    if (light.surfaces) {
        light.grids.assign(volumes, grid_around(supports, view, scalar_step * frame.slice_spacing, elements, true));
        return light;
    }
    // Kernels that a part does not have may be smaller.
    const bool known = !scene.part || std::all_of(scene.fields.begin(), scene.fields.end(),
                                                  [](const auto& field) { return as_regular(field.get()) != nullptr; });
    const auto grid_of = [&](double step) {
        for (std::size_t number = 0; number < light.grids.size(); ++number) {
            if (light.grids[number].wanted == step) {
                return number;
            }
        }
        LightGrid grid = grid_around(supports, view, step, elements);
        grid.shows_matter = known && !view.plan.filter && !is_cut(scene) &&
                            shows_kernels(scene, std::max(grid.step, grid.spacing * grid.every));
        light.grids.push_back(grid);
        return light.grids.size() - 1;
    };
    const double usual = light_step(frame, smallest_pixel(frame, view.camera, supports));
    if (view.plan.shadows) {
        for (const Light& one : scene.lights) {
            light.lights.push_back(world_direction(one, view.camera));
        }
        light.light_grid = grid_of(usual);
    }
    if (view.plan.ambient_occlusion) {
        light.radius = occlusion_steps(*scene.ambient_occlusion, frame.slice_spacing);
        const double step = open_step(frame, light.radius, usual);
        // From a grid twice as fine where slices are, and there is none of this step.
        light.open_is_halved = !(view.plan.shadows && usual == step) && step >= 2.0 * frame.slice_spacing;
        light.open_grid = grid_of(light.open_is_halved ? 0.5 * step : step);
    }
    return light;
}

LightVolume filled(const LightGrid& grid, const Group* group, const FillLight& fill) {
    LightVolume volume = laid_out(grid, group != nullptr);
    fill(grid, all_of(grid), group, volume.values.data() + volume.index(0, 0, 1));
    return volume;
}

std::vector<LightPiece> pieces_of(const LightPlan& light, const Scene& part, const FillLight& fill) {
    std::vector<LightPiece> pieces;
    const std::vector<Group> groups = part.groups();
    for (std::size_t number = 0; number < light.grids.size(); ++number) {
        const LightGrid& grid = light.grids[number];
        // What a leaning cell holds is cut by the cell itself: the fill draws no other points of it.
        const Parallelepiped& cell = part.part->cell;
        const LightCut cut = cut_of(grid, cell.upright() ? cell.box : supports_world(part));
        if (cut.empty()) {
            continue;
        }
        LightPiece piece;
        piece.grid = number;
        piece.first = {cut.first[0], cut.first[1], static_cast<int>(cut.first_slice / grid.every) + 1};
        piece.counts = {cut.size.width, cut.size.height, static_cast<int>(cut.planes(grid))};
        piece.values.assign(cut.elements(grid), 0.0F);
        fill(grid, cut, light.surfaces ? &groups[number] : nullptr, piece.values.data());
        if (light.surfaces && !cell.upright()) {
            keep_elements(grid, cut, cell, piece.values);
        }
        if (std::any_of(piece.values.begin(), piece.values.end(), [](float value) { return value != 0.0F; })) {
            pieces.push_back(std::move(piece));
        }
    }
    return pieces;
}

} // namespace sheetsplat
