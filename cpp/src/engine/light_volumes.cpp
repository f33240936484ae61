#include "light_volumes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <new>
#include <utility>

#include <glm/geometric.hpp>

#include "backend_choice.hpp"
#include "base/clock.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "plan/limits_common.hpp"
#include "same_scene.hpp"
#include "sheetsplat/error.hpp"
#include "view/light_march.hpp"
#include "view/surface_lines.hpp"

namespace sheetsplat {

namespace {

/// Volumes that are kept: enough for a few scenes, or for the stages of one picture.
constexpr std::size_t most_kept = 32;
/// Grids are this much coarser until they fit.
constexpr double coarser = 1.25;

/// Elements of a grid that shows all kernels in the radius of the smallest one.
constexpr double least_radius_of_cells = 2.0;

double least_semi_axis(const Field& field) {
    const EllipsoidField* ellipsoids = as_ellipsoids(&field);
    if (ellipsoids != nullptr) {
        return ellipsoids->scale_range()[0];
    }
    const Vec3 axes = as_regular(&field)->semi_axes_world();
    return std::min({axes.x, axes.y, axes.z});
}

/// The plan with which the opacity along a light is computed: point sampling, no shading, no outputs beside opacity.
DrawPlan through(const DrawPlan& plan, const Scene& scene) {
    DrawPlan made = plan;
    made.mode = Mode::composite;
    made.sampling = Sampling::point;
    made.projection = Projection::orthographic;
    made.preintegration = made.second_order = false;
    made.gradient = made.lit = made.analytic_gradient = made.gradient_opacity = false;
    made.specular = made.two_sided = made.depth_cue = made.shadows = made.ambient_occlusion = false;
    made.stop = made.coverage = made.depth = false;
    made.depth_limit = false; // It belongs to the picture's rays.
    const std::vector<Group> groups = scene.groups();
    made.empty_test = std::any_of(groups.begin(), groups.end(), [](const Group& group) {
        return !group.transfer_function->transparent_over(0.0, 0.0);
    });
    made.weight = made.threshold || made.empty_test;
    return made;
}

/// Step of the grids on which light is kept: a slice distance, or twice, four times ... as much where pixels are
/// larger. Few different values, so that a camera that moves a little closer can use the same volumes.
double light_step(const Frame& frame) {
    const double pixels = std::clamp(frame.smallest_pixel() / frame.slice_spacing, 1.0, 1e6);
    return frame.slice_spacing * std::exp2(std::floor(std::log2(pixels)));
}

/// Grid step of ambient occlusion, which is a mean over directions and may be coarser: a quarter of its radius, up to
/// two slice distances or half of the step that pixels call for.
double open_step(const Frame& frame, double steps) {
    const double most = std::max(2.0, 0.5 * light_step(frame) / frame.slice_spacing);
    return frame.slice_spacing * std::exp2(std::floor(std::log2(std::clamp(0.25 * steps, 1.0, most))));
}

/// Grid step of rho in mode isosurface, in slice distances: half of one moves the edges of shadows by a few hundredths
/// of a sample distance.
constexpr double scalar_step = 0.5;

/// The plan with which rho of a group of fields is sampled.
DrawPlan through_group(const DrawPlan& plan, const Scene& scene, const Group& group) {
    DrawPlan made = through(plan, scene);
    made.empty_test = false;
    made.field_units.clear(); // Iso values hold for all groups.
    made.own_sheets.assign(scene.fields.size(), -1);
    int divided = 0;
    for (std::size_t field = group.first; field < group.last; ++field) {
        if (scene.fields[field]->normalization() == Normalization::threshold) {
            made.own_sheets[field] = divided++;
        }
    }
    // A single quotient needs no sheets of its own.
    made.threshold = made.weight = divided > 0 && group.last - group.first == 1;
    if (divided == 0 || made.threshold) {
        made.own_sheets.clear();
    }
    return made;
}

/// A scene that is looked at along a light, towards where it goes.
struct LightView {
    Camera camera;
    Size size;
    int every = 1;
    double step = 0.0;
};

/// The view of all supports with elements of about `step`, or as many as fit. Along the light these are whole slice
/// distances; cubes: as across it.
LightView view_of(const Scene& scene, const Vec3& towards_light, double step, double elements, const Reach& reach,
                  bool cubes = false) {
    const Vec3 middle = scene.centres_world().centre();
    const Vec3 size = glm::abs(towards_light);
    const Vec3 up = size.y <= size.x && size.y <= size.z ? Vec3(0.0, 1.0, 0.0)
                    : size.x <= size.z                   ? Vec3(1.0, 0.0, 0.0)
                                                         : Vec3(0.0, 0.0, 1.0);
    const Camera aligned = Camera::orthographic(middle, middle - towards_light, up, 1.0);
    const auto extent = [&](const Vec3& direction) {
        std::array<double, 2> all{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
        for (const auto& field : scene.fields) {
            if (field->size() > 0) {
                const std::array<double, 2> own =
                    reach ? reach(*field, middle, direction) : field->reach_along(middle, direction);
                all = {std::min(all[0], own[0]), std::max(all[1], own[1])};
            }
        }
        return all;
    };
    const auto across = extent(aligned.right_world()), upwards = extent(aligned.up_world()),
               along = extent(aligned.back_world());
    const double spacing = scene.slice_distance();
    LightView view{aligned, {}, 1, step};
    // Beyond an edge lies an element that nothing reaches: what is outside of the grid has its number.
    const auto count = [](double length, double pitch) { return std::ceil(length / pitch) + 3.0; };
    for (;; view.step *= coarser) {
        view.every = static_cast<int>(std::clamp(std::round(view.step / spacing), 1.0, 1e6));
        const double wide = count(across[1] - across[0], view.step), high = count(upwards[1] - upwards[0], view.step);
        const double deep = count(along[1] - along[0], cubes ? view.step : spacing * view.every);
        if (wide * high * deep <= elements && wide < 16384.0 && high < 16384.0) {
            view.size = {static_cast<int>(wide), static_cast<int>(high)};
            break;
        }
    }
    const Vec3 eye = middle + 0.5 * (across[0] + across[1]) * aligned.right_world() +
                     0.5 * (upwards[0] + upwards[1]) * aligned.up_world();
    view.camera = Camera::orthographic(eye, eye - towards_light, up, view.step * view.size.height);
    return view;
}

/// Calls draw(job) with the processor's job for another view of what the picture shows.
template <class Draw>
void draw_into(const Request& request, const DrawPlan& plan, const Indexed& indexed, const Prepared& prepared,
               const Camera& camera, const Frame& frame, const Draw& draw) {
    std::vector<FieldView> lattices;
    for (const std::size_t field : prepared.view_fields) {
        lattices.push_back(make_field_view(*as_regular(request.scene.fields[field].get()), camera, frame,
                                           Sampling::point, plan.unit_of(field), filter_of(plan)));
    }
    const std::vector<EllipsoidView> scattered = views_of(indexed, plan, camera, frame, Sampling::point);
    backend_cpu::Job job = cpu_job(request, prepared, indexed, lattices, scattered, camera, frame, plan);
    // Light comes before the picture, of which nothing is done yet.
    const Progress nothing_yet =
        request.progress ? Progress([&request](double) { return request.progress(0.0); }) : Progress();
    job.progress = &nothing_yet;
    draw(job);
}

/// -ln(1 - alpha) of a slice distance, on a grid along the world's axes with a step of about `step`.
LightVolume absorption_grid(const Request& request, const DrawPlan& plan, const Indexed& indexed,
                            const Prepared& prepared, const Reach& reach, double step, double elements,
                            backend_cpu::CpuRenderer& processor) {
    const LightView view = view_of(request.scene, Vec3(0.0, 0.0, 1.0), step, elements, reach);
    const Frame frame = make_frame(request.scene, view.camera, view.size, reach);
    LightVolume volume;
    draw_into(request, plan, indexed, prepared, view.camera, frame,
              [&](const backend_cpu::Job& job) { processor.absorb(job, view.every, volume); });
    // Sums up to each plane become means over the slices from plane to plane, which lie half their number before it.
    const std::size_t plane = volume.index(0, 0, 1);
    const float per_slice = 1.0F / static_cast<float>(view.every);
    for (std::size_t element = volume.values.size(); element-- > plane;) {
        volume.values[element] = per_slice * (volume.values[element] - volume.values[element - plane]);
    }
    volume.origin += 0.5 * (view.every + 1) * frame.slice_spacing * view.camera.back_world();
    return volume;
}

/// rho of a group of fields on a grid along the world's axes.
LightVolume scalars(const Request& request, const DrawPlan& plan, const Group& group, const Indexed& indexed,
                    const Prepared& prepared, const Reach& reach, double elements,
                    backend_cpu::CpuRenderer& processor) {
    const LightView view =
        view_of(request.scene, Vec3(0.0, 0.0, 1.0), scalar_step * prepared.frame.slice_spacing, elements, reach, true);
    Scene scene = request.scene;
    scene.reference_length = scene.reference_distance();
    scene.slice_spacing = view.step;
    scene.later_groups.clear(); // The fields of other groups are left out below.
    const Frame frame = make_frame(scene, view.camera, view.size, reach);
    LightVolume volume;
    draw_into(request.with(scene), plan, indexed, prepared, view.camera, frame, [&](backend_cpu::Job& job) {
        const auto of_others = [&group](const auto& part) {
            return part.field < group.first || part.field >= group.last;
        };
        job.regular.erase(std::remove_if(job.regular.begin(), job.regular.end(), of_others), job.regular.end());
        job.ellipsoids.erase(std::remove_if(job.ellipsoids.begin(), job.ellipsoids.end(), of_others),
                             job.ellipsoids.end());
        processor.sample(job, volume);
    });
    return volume;
}

bool same_opacities(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const TransferPoint& x, const TransferPoint& y) {
        return x.value == y.value && x.opacity == y.opacity;
    });
}

} // namespace

bool shows_kernels(const Scene& scene, const LightVolume& grid) {
    double step = 0.0;
    for (const Vec3& per_step : grid.per_step) {
        step = std::max(step, 1.0 / glm::length(per_step));
    }
    return std::all_of(scene.fields.begin(), scene.fields.end(), [step](const auto& field) {
        return field->size() == 0 || least_semi_axis(*field) >= least_radius_of_cells * step;
    });
}

bool shows_matter(const Scene& scene, const DrawPlan& plan, const LightVolume& absorption) {
    const std::vector<Group> groups = scene.groups();
    return !plan.filter && shows_kernels(scene, absorption) &&
           std::none_of(groups.begin(), groups.end(),
                        [](const Group& group) { return group.transfer_function->has_steps(); });
}

bool LightVolumeCache::Origin::operator==(const Origin& other) const {
    return fields == other.fields && groups == other.groups && versions == other.versions &&
           same_opacities(points, other.points) && same(clip, other.clip) && slice_spacing == other.slice_spacing &&
           reference_length == other.reference_length && value_unit == other.value_unit && filter == other.filter &&
           precision == other.precision;
}

template <class Make>
std::shared_ptr<const LightVolume> LightVolumeCache::find(const Entry& wanted, std::size_t& used, const Make& make) {
    auto found = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
        return entry.of == wanted.of && entry.group == wanted.group && entry.direction == wanted.direction &&
               entry.step == wanted.step && entry.radius == wanted.radius && entry.origin == wanted.origin;
    });
    if (found == entries_.end()) {
        Entry made = wanted;
        made.volume = std::make_shared<const LightVolume>(make());
        // (Others may have been found or made for it.)
        entries_.push_back(std::move(made));
        found = std::prev(entries_.end());
    }
    std::rotate(entries_.begin(), found, std::next(found));
    ++used;
    return entries_.front().volume;
}

void LightVolumeCache::tidy(const Scene& scene, std::size_t used) {
    std::size_t number = 0;
    double elements = 0.0;
    entries_.erase(std::remove_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) {
                                      elements += static_cast<double>(entry.volume->values.size());
                                      return ++number > used &&
                                             (entry.turns || entry.origin.fields != scene.fields ||
                                              elements > static_cast<double>(most_light_elements_of_all) ||
                                              number > most_kept);
                                  }),
                   entries_.end());
}

LightVolumes LightVolumeCache::of(const Request& request, const Prepared& prepared, const Indexed& indexed,
                                  const Reach& reach, backend_cpu::CpuRenderer& processor, Image& image) {
    const auto start = Clock::now();
    const Scene& scene = request.scene;
    const DrawPlan plan = through(prepared.plan, scene);
    std::vector<TransferPoint> points;
    std::vector<std::size_t> groups;
    for (const Group& group : scene.groups()) {
        const std::vector<TransferPoint>& own = group.transfer_function->points();
        points.insert(points.end(), own.begin(), own.end());
        groups.insert(groups.end(), {group.first, own.size()});
    }
    Origin origin{scene.fields,
                  std::move(groups),
                  {},
                  std::move(points),
                  plan.clip ? scene.clip : Clip{},
                  prepared.frame.slice_spacing,
                  prepared.frame.reference_length,
                  plan.value_unit,
                  plan.filter,
                  plan.precision};
    for (const RunsEntry* entry : indexed.runs) {
        origin.versions.push_back(entry->version);
    }
    for (const GridEntry* entry : indexed.grids) {
        origin.versions.push_back(entry->version);
    }
    std::size_t used = 0;
    LightVolumes volumes;
    const double spacing = prepared.frame.slice_spacing;
    const bool by_surfaces = prepared.plan.mode == Mode::isosurface;
    const std::vector<Group> casting = by_surfaces ? scene.groups() : std::vector<Group>{};
    const std::size_t grids = by_surfaces ? casting.size() : (prepared.plan.shadows ? scene.lights.size() : 0) + 2;
    const double elements = std::min(static_cast<double>(most_light_elements),
                                     static_cast<double>(most_light_elements_of_all) / static_cast<double>(grids));
    try {
        if (by_surfaces && prepared.frame.slices > 0) {
            // Neither what is transparent nor what is cut off matters to rho.
            Origin of_rho = origin;
            of_rho.points.clear();
            of_rho.clip = Clip{};
            of_rho.reference_length = 0.0;
            for (std::size_t number = 0; number < casting.size(); ++number) {
                Entry wanted{of_rho, Entry::Of::rho};
                wanted.origin.groups = {casting[number].first, casting[number].last};
                wanted.group = number;
                volumes.groups.push_back(find(wanted, used, [&] {
                    return scalars(request, through_group(prepared.plan, scene, casting[number]), casting[number],
                                   indexed, prepared, reach, elements, processor);
                }));
            }
        }
        if (!by_surfaces && prepared.frame.slices > 0) {
            OwnPool pool;
            const auto threads = [&]() -> ThreadPool& {
                if (!pool) {
                    pool.reset(new ThreadPool(thread_count(request.options.threads)));
                }
                return *pool;
            };
            const std::function<void()> poll = [&request] { report_progress(request.progress, 0.0); };
            const auto absorbed = [&](double step) {
                Entry wanted{origin, Entry::Of::absorption};
                wanted.step = step;
                return find(wanted, used, [&] {
                    return absorption_grid(request, plan, indexed, prepared, reach, step, elements, processor);
                });
            };
            const auto where = [&](const LightVolume& grid) {
                return shows_matter(scene, prepared.plan, grid) ? WhereLight::near_matter : WhereLight::everywhere;
            };
            const double step = light_step(prepared.frame);
            for (std::size_t number = 0; prepared.plan.shadows && number < scene.lights.size(); ++number) {
                const Light& light = scene.lights[number];
                Entry wanted{origin, Entry::Of::transmittance};
                wanted.direction = world_direction(light, request.camera);
                wanted.step = step;
                wanted.turns = light.space == LightSpace::eye;
                volumes.lights.push_back(find(wanted, used, [&] {
                    const auto grid = absorbed(step);
                    return transmittance(*grid, wanted.direction, spacing, where(*grid), threads(), poll);
                }));
            }
            if (prepared.plan.ambient_occlusion) {
                Entry wanted{origin, Entry::Of::openness};
                wanted.radius = occlusion_steps(*scene.ambient_occlusion, spacing);
                wanted.step = open_step(prepared.frame, wanted.radius);
                volumes.openness = find(wanted, used, [&] {
                    // From a grid twice as fine where slices are, and there is none of this step.
                    const bool same = prepared.plan.shadows && step == wanted.step;
                    const bool finer = !same && wanted.step >= 2.0 * spacing;
                    std::shared_ptr<const LightVolume> grid = absorbed(finer ? 0.5 * wanted.step : wanted.step);
                    // (What is halved spreads.)
                    const WhereLight near = where(*grid);
                    if (finer) {
                        grid = std::make_shared<const LightVolume>(halved(*grid));
                    }
                    while (grid->values.size() > most_occlusion_elements) {
                        grid = std::make_shared<const LightVolume>(halved(*grid));
                    }
                    const std::array<Vec3, directions_around> around = around_world();
                    return openness(*grid, {around.begin(), around.end()}, wanted.radius, spacing, near, threads(),
                                    poll);
                });
            }
        }
    } catch (const std::bad_alloc&) {
        throw OutOfMemory(Complaint{"shadows or ambient occlusion cannot be drawn", "not enough memory",
                                    "memory for the opacity along rays to lights",
                                    "leave out " + option_ref("shadows") + " and " + option_ref("ambient_occlusion")});
    }
    tidy(scene, used);
    const auto grid = std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
        return entry.of == Entry::Of::absorption && entry.origin == origin;
    });
    absorption_ = grid != entries_.end() ? grid->volume : nullptr;
    std::size_t bytes = 0;
    for (const Entry& entry : entries_) {
        bytes += entry.volume->bytes();
    }
    image.stats["seconds_light"] = seconds_since(start);
    image.stats["bytes_light"] = static_cast<double>(bytes);
    return volumes;
}

} // namespace sheetsplat
