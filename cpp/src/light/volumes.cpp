#include "light/volumes.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <new>
#include <utility>

#include "base/clock.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "light/march.hpp"
#include "light/surface_lines.hpp"
#include "plan/limits_common.hpp"
#include "scene/same_scene.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat {

namespace {

/// Volumes that are kept: enough for a few scenes, or for the stages of one picture.
constexpr std::size_t most_kept = 32;

bool same_opacities(const std::vector<TransferPoint>& a, const std::vector<TransferPoint>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const TransferPoint& x, const TransferPoint& y) {
        return x.value == y.value && x.opacity == y.opacity;
    });
}

/// Threads that light is followed on, begun where any is.
class LightThreads {
  public:
    explicit LightThreads(int threads) : threads_(threads) {}
    ThreadPool& pool() {
        if (!pool_) {
            pool_.reset(new ThreadPool(threads_));
        }
        return *pool_;
    }

  private:
    int threads_;
    OwnPool pool_;
};

WhereLight where(const LightGrid& grid) { return grid.shows_matter ? WhereLight::near_matter : WhereLight::everywhere; }

LightVolume open_around(const LightPlan& plan, std::shared_ptr<const LightVolume> absorption, LightThreads& threads,
                        const std::function<void()>& poll) {
    // (What is halved spreads.)
    if (plan.open_is_halved) {
        absorption = std::make_shared<const LightVolume>(halved(*absorption));
    }
    while (absorption->values.size() > most_occlusion_elements) {
        absorption = std::make_shared<const LightVolume>(halved(*absorption));
    }
    const std::array<Vec3, directions_around> around = around_world();
    return openness(FollowedGrid(*absorption, where(plan.grids[plan.open_grid])), {around.begin(), around.end()},
                    plan.radius, plan.slice_spacing, threads.pool(), poll);
}

[[noreturn]] void out_of_memory() {
    throw OutOfMemory(Complaint{"shadows or ambient occlusion cannot be drawn", "not enough memory",
                                "memory for the opacity along rays to lights",
                                "leave out " + option_ref("shadows") + " and " + option_ref("ambient_occlusion")});
}

} // namespace

LightVolumes light_volumes_of(const LightPlan& light, std::vector<LightVolume> grids, int threads,
                              const Progress& progress) {
    LightVolumes volumes;
    LightThreads own(threads);
    const std::function<void()> poll = [&progress] { report_progress(progress, 0.0); };
    try {
        std::vector<std::shared_ptr<const LightVolume>> filled;
        filled.reserve(grids.size());
        for (LightVolume& grid : grids) {
            filled.push_back(std::make_shared<const LightVolume>(std::move(grid)));
        }
        if (light.surfaces) {
            volumes.groups = std::move(filled);
            return volumes;
        }
        if (!light.lights.empty()) {
            const FollowedGrid grid(*filled[light.light_grid], where(light.grids[light.light_grid]));
            for (const Vec3& towards : light.lights) {
                volumes.lights.push_back(std::make_shared<const LightVolume>(
                    transmittance(grid, towards, light.slice_spacing, own.pool(), poll)));
            }
        }
        if (light.radius > 0.0) {
            volumes.openness =
                std::make_shared<const LightVolume>(open_around(light, filled[light.open_grid], own, poll));
        }
    } catch (const std::bad_alloc&) {
        out_of_memory();
    }
    return volumes;
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

LightVolumes LightVolumeCache::of(const LitView& view, std::vector<std::uint64_t> versions, const Reach& reach,
                                  const FillLight& fill, Image& image) {
    const auto start = Clock::now();
    const Scene& scene = view.scene;
    const DrawPlan& plan = view.plan;
    std::vector<TransferPoint> points;
    std::vector<std::size_t> groups;
    for (const Group& group : scene.groups()) {
        const std::vector<TransferPoint>& own = group.transfer_function->points();
        points.insert(points.end(), own.begin(), own.end());
        groups.insert(groups.end(), {group.first, own.size()});
    }
    Origin origin{scene.fields,
                  std::move(groups),
                  std::move(versions),
                  std::move(points),
                  plan.clip ? scene.clip : Clip{},
                  view.frame.slice_spacing,
                  view.frame.reference_length,
                  plan.value_unit,
                  plan.filter,
                  plan.precision};
    std::size_t used = 0;
    LightVolumes volumes;
    const LightPlan light = make_light_plan(view, reach);
    try {
        if (light.surfaces && !light.grids.empty()) {
            // Neither what is transparent nor what is cut off matters to rho.
            Origin of_rho = origin;
            of_rho.points.clear();
            of_rho.clip = Clip{};
            of_rho.reference_length = 0.0;
            const std::vector<Group> casting = scene.groups();
            for (std::size_t number = 0; number < casting.size(); ++number) {
                Entry wanted{of_rho, Entry::Of::rho};
                wanted.origin.groups = {casting[number].first, casting[number].last};
                wanted.group = number;
                volumes.groups.push_back(
                    find(wanted, used, [&] { return filled(light.grids[number], &casting[number], fill); }));
            }
        }
        if (!light.surfaces && !light.grids.empty()) {
            LightThreads threads(view.threads);
            const std::function<void()> poll = [&view] { report_progress(view.progress, 0.0); };
            const auto absorbed = [&](const LightGrid& grid) {
                Entry wanted{origin, Entry::Of::absorption};
                wanted.step = grid.wanted;
                return find(wanted, used, [&] { return filled(grid, nullptr, fill); });
            };
            for (std::size_t number = 0; number < light.lights.size(); ++number) {
                Entry wanted{origin, Entry::Of::transmittance};
                wanted.direction = light.lights[number];
                wanted.step = light.grids[light.light_grid].wanted;
                wanted.turns = scene.lights[number].space == LightSpace::eye;
                volumes.lights.push_back(find(wanted, used, [&] {
                    const LightGrid& grid = light.grids[light.light_grid];
                    absorbed(grid);
                    // (It was put first.)
                    std::shared_ptr<const FollowedGrid>& followed = entries_.front().followed;
                    if (!followed || followed->where() != where(grid)) {
                        followed = std::make_shared<const FollowedGrid>(*entries_.front().volume, where(grid));
                    }
                    return transmittance(*followed, wanted.direction, light.slice_spacing, threads.pool(), poll);
                }));
            }
            if (light.radius > 0.0) {
                const LightGrid& grid = light.grids[light.open_grid];
                Entry wanted{origin, Entry::Of::openness};
                wanted.radius = light.radius;
                wanted.step = light.open_is_halved ? 2.0 * grid.wanted : grid.wanted;
                volumes.openness =
                    find(wanted, used, [&] { return open_around(light, absorbed(grid), threads, poll); });
            }
        }
    } catch (const std::bad_alloc&) {
        out_of_memory();
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
