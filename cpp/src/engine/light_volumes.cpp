#include "light_volumes.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <utility>

#include <glm/geometric.hpp>

#include "base/clock.hpp"
#include "plan/limits_common.hpp"
#include "same_scene.hpp"
#include "sheetsplat/error.hpp"
#include "view/surface_lines.hpp"

namespace sheetsplat {

namespace {

/// Volumes that are kept: enough for a few scenes, or for the stages of one picture.
constexpr std::size_t most_kept = 32;
/// Grids are this much coarser until they fit.
constexpr double coarser = 1.25;

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

/// Grid step of ambient occlusion, which is a mean over directions and may be coarser.
double open_step(double slice_spacing, double steps) { return slice_spacing * std::clamp(0.25 * steps, 1.0, 2.0); }

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
                                           Sampling::point, plan.unit_of(field)));
    }
    const std::vector<EllipsoidView> scattered = views_of(indexed, plan, camera, frame, Sampling::point);
    backend_cpu::Job job = cpu_job(request, prepared, indexed, lattices, scattered, camera, frame, plan);
    // Light comes before the picture, of which nothing is done yet.
    const Progress nothing_yet =
        request.progress ? Progress([&request](double) { return request.progress(0.0); }) : Progress();
    job.progress = &nothing_yet;
    draw(job);
}

/// -ln of what is left of light on its way to the planes of a volume.
LightVolume absorption(const Request& request, const DrawPlan& plan, const Indexed& indexed, const Prepared& prepared,
                       const Reach& reach, const LightView& view, backend_cpu::CpuRenderer& processor) {
    const Frame frame = make_frame(request.scene, view.camera, view.size, reach);
    LightVolume volume;
    draw_into(request, plan, indexed, prepared, view.camera, frame,
              [&](const backend_cpu::Job& job) { processor.absorb(job, view.every, volume); });
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

/// Replaces the absorption in front of each point by the sum of two transmittances: of the `steps` slices before the
/// point, and of as many behind it.
void look_around(int every, double steps, LightVolume& volume) {
    const std::size_t plane = static_cast<std::size_t>(volume.counts[0]) * static_cast<std::size_t>(volume.counts[1]);
    const int planes = volume.counts[2];
    const std::vector<float> sums = std::move(volume.values);
    volume.values.assign(sums.size(), 0.0F);
    /// Absorption before a slice, between two planes.
    struct Between {
        const float* from;
        const float* to;
        float share;
        [[nodiscard]] float at(std::size_t element) const {
            return from[element] + share * (to[element] - from[element]);
        }
    };
    const auto before = [&](double slice) {
        const double place = std::clamp(slice / every, 0.0, static_cast<double>(planes - 1));
        const int whole = std::min(static_cast<int>(place), std::max(planes - 2, 0));
        const auto start = [&](int number) { return sums.data() + static_cast<std::size_t>(number) * plane; };
        return Between{start(whole), start(std::min(whole + 1, planes - 1)), static_cast<float>(place - whole)};
    };
    for (int n = 0; n < planes; ++n) {
        const double slice = static_cast<double>(n) * every;
        const Between far = before(slice - steps), here = before(slice);
        const Between after = before(slice + 1.0), behind = before(slice + 1.0 + steps);
        float* out = volume.values.data() + static_cast<std::size_t>(n) * plane;
        for (std::size_t element = 0; element < plane; ++element) {
            const float ahead = here.at(element) - far.at(element), past = behind.at(element) - after.at(element);
            // exp is skipped for empty space, which is most of it.
            out[element] = (ahead > 0.0F ? std::exp(-ahead) : 1.0F) + (past > 0.0F ? std::exp(-past) : 1.0F);
        }
    }
}

/// The world's directions, one of each opposite pair.
std::array<Vec3, 7> directions() {
    const double third = 1.0 / std::sqrt(3.0);
    return {Vec3(1.0, 0.0, 0.0),       Vec3(0.0, 1.0, 0.0),        Vec3(0.0, 0.0, 1.0),
            Vec3(third, third, third), Vec3(third, third, -third), Vec3(third, -third, third),
            Vec3(-third, third, third)};
}

/// A grid along the world's axes over all supports, empty.
LightVolume world_grid(const Scene& scene, double step, double elements) {
    const Box box = supports_world(scene);
    LightVolume volume;
    const Vec3 extent = box.extent();
    for (;; step *= coarser) {
        const Vec3 counts = glm::ceil(extent / step) + 2.0;
        if (counts.x * counts.y * counts.z <= elements) {
            for (int axis = 0; axis < 3; ++axis) {
                volume.counts[static_cast<std::size_t>(axis)] = static_cast<int>(counts[axis]);
                Vec3 per_step(0.0);
                per_step[axis] = 1.0 / step;
                volume.per_step[static_cast<std::size_t>(axis)] = per_step;
            }
            volume.origin = box.centre() - 0.5 * step * (counts - 1.0);
            break;
        }
    }
    volume.values.assign(static_cast<std::size_t>(volume.counts[0]) * static_cast<std::size_t>(volume.counts[1]) *
                             static_cast<std::size_t>(volume.counts[2]),
                         0.0F);
    return volume;
}

void add(const LightVolume& from, LightVolume& to) {
    const Vec3 steps(1.0 / to.per_step[0].x, 1.0 / to.per_step[1].y, 1.0 / to.per_step[2].z);
    std::size_t element = 0;
    for (int w = 0; w < to.counts[2]; ++w) {
        for (int v = 0; v < to.counts[1]; ++v) {
            for (int u = 0; u < to.counts[0]; ++u, ++element) {
                to.values[element] += static_cast<float>(from.at(to.origin + Vec3(u, v, w) * steps));
            }
        }
    }
}

bool same_opacities(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const TransferPoint& x, const TransferPoint& y) {
        return x.value == y.value && x.opacity == y.opacity;
    });
}

} // namespace

bool LightVolumeCache::Origin::operator==(const Origin& other) const {
    return fields == other.fields && groups == other.groups && versions == other.versions &&
           same_opacities(points, other.points) && same(clip, other.clip) && slice_spacing == other.slice_spacing &&
           reference_length == other.reference_length && value_unit == other.value_unit && filter == other.filter &&
           precision == other.precision;
}

template <class Serves, class Make>
std::shared_ptr<const LightVolume> LightVolumeCache::find(const Serves& serves, const Make& make) {
    auto found = std::find_if(entries_.begin(), entries_.end(), serves);
    if (found == entries_.end()) {
        entries_.push_back(make());
        found = std::prev(entries_.end());
    }
    std::rotate(entries_.begin(), found, std::next(found));
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
    const std::size_t grids = by_surfaces ? casting.size() : (prepared.plan.shadows ? scene.lights.size() : 0) + 1;
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
                const auto group = static_cast<int>(number);
                of_rho.groups = {casting[number].first, casting[number].last};
                volumes.groups.push_back(
                    find([&](const Entry& entry) { return entry.group == group && entry.origin == of_rho; },
                         [&] {
                             Entry entry;
                             entry.origin = of_rho;
                             entry.group = group;
                             entry.volume = std::make_shared<const LightVolume>(
                                 scalars(request, through_group(prepared.plan, scene, casting[number]), casting[number],
                                         indexed, prepared, reach, elements, processor));
                             return entry;
                         }));
                ++used;
            }
        }
        if (!by_surfaces && prepared.plan.shadows && prepared.frame.slices > 0) {
            const double step = light_step(prepared.frame);
            for (const Light& light : scene.lights) {
                const Vec3 direction = world_direction(light, request.camera);
                volumes.lights.push_back(find(
                    [&](const Entry& entry) {
                        return entry.group < 0 && entry.direction == direction && entry.step == step &&
                               entry.origin == origin;
                    },
                    [&] {
                        LightVolume made = absorption(request, plan, indexed, prepared, reach,
                                                      view_of(scene, direction, step, elements, reach), processor);
                        for (float& value : made.values) {
                            value = std::exp(-std::min(value, 80.0F));
                        }
                        return Entry{origin,
                                     -1,
                                     direction,
                                     step,
                                     0.0,
                                     light.space == LightSpace::eye,
                                     std::make_shared<const LightVolume>(std::move(made))};
                    }));
                ++used;
            }
        }
        if (!by_surfaces && prepared.plan.ambient_occlusion && prepared.frame.slices > 0) {
            const double steps = occlusion_steps(*scene.ambient_occlusion, spacing);
            volumes.openness = find(
                [&](const Entry& entry) {
                    return entry.group < 0 && entry.direction == Vec3(0.0) && entry.radius == steps &&
                           entry.origin == origin;
                },
                [&] {
                    const auto most_elements = static_cast<double>(most_occlusion_elements);
                    LightVolume open = world_grid(scene, open_step(spacing, steps), most_elements);
                    const double step = 1.0 / open.per_step[0].x;
                    for (const Vec3& direction : directions()) {
                        const LightView view = view_of(scene, direction, step, 4.0 * most_elements, reach);
                        LightVolume around = absorption(request, plan, indexed, prepared, reach, view, processor);
                        look_around(view.every, steps, around);
                        add(around, open);
                    }
                    for (float& value : open.values) {
                        value *= 1.0F / 14.0F;
                    }
                    return Entry{origin,
                                 -1,
                                 Vec3(0.0),
                                 step,
                                 steps,
                                 false,
                                 std::make_shared<const LightVolume>(std::move(open))};
                });
            ++used;
        }
    } catch (const std::bad_alloc&) {
        throw OutOfMemory(Complaint{"shadows or ambient occlusion cannot be drawn", "not enough memory",
                                    "memory for the opacity along rays to lights",
                                    "leave out " + option_ref("shadows") + " and " + option_ref("ambient_occlusion")});
    }
    tidy(scene, used);
    std::size_t bytes = 0;
    for (const Entry& entry : entries_) {
        bytes += entry.volume->bytes();
    }
    image.stats["seconds_light"] = seconds_since(start);
    image.stats["bytes_light"] = static_cast<double>(bytes);
    return volumes;
}

} // namespace sheetsplat
