#include "light/light_error.hpp"

#include <algorithm>
#include <utility>

#include "at_points.hpp"
#include "base/poll.hpp"
#include "base/threads.hpp"
#include "light/grids.hpp"
#include "plan/charge_effects.hpp"
#include "plan/effect_table.hpp"
#include "scene/mode_rules.hpp"
#include "shown_spots.hpp"

namespace sheetsplat {

namespace {

/// Kernels of which a grid is made for a picture that nobody asked the error of.
constexpr std::size_t most_scattered = 200'000;
/// Light that adds less than this to a pixel is passed over.
constexpr double least_share = 1e-4;

/// Calls work(number) for numbers below `count` on all threads.
template <class Work>
void for_each(std::size_t count, ThreadPool& pool, const Progress& progress, double done, const Work& work) {
    pool.run(
        count, [&](std::size_t task, int) { work(task); }, [&] { report_progress(progress, done); });
}

/// What the scene, or its part, leaves of light on lines from spots, and what the picture shows of light at its own.
LightLines lines_from(const std::vector<LightSpot>& spots, std::size_t part, const ProbePixels& probes,
                      const LitView& lit, const LightAtPoints& light, const ShownSpots& view, ThreadPool& pool,
                      double done) {
    LightLines lines;
    lines.absorbed = light.surfaces();
    lines.lights = lit.plan.shadows ? lit.scene.lights.size() : 0;
    lines.directions = lines.lights + (lit.plan.ambient_occlusion ? directions_around : 0);
    const std::size_t each = 4 * (lines.lights + (lit.plan.ambient_occlusion ? 1 : 0));
    lines.left.assign(spots.size() * lines.directions, lines.absorbed ? 0.0 : 1.0);
    lines.shown.assign(spots.size() * each, 0.0);
    for_each(spots.size(), pool, lit.progress, done, [&](std::size_t task) {
        const LightSpot& spot = spots[task];
        const bool own = spot.part == part;
        const auto [column, row] = probes.pixels.at(spot.number);
        const Vec3 world = view.place_of(column, row, spot);
        double* left = &lines.left[task * lines.directions];
        double* shown = &lines.shown[task * each];
        const double least = least_share / std::max(spot.stands_for[0], spot.stands_for[1]);
        const std::vector<Vec3> most =
            own && lines.lights > 0 ? view.most_of_lights(column, row, spot, least) : std::vector<Vec3>{};
        const auto show = [&shown](const Vec3& adds, double drawn) {
            shown = std::copy_n(&adds.x, 3, shown);
            *shown++ = drawn;
        };
        for (std::size_t number = 0; number < lines.lights; ++number) {
            const bool dark = own && most[number] == Vec3(0.0);
            if (!dark) {
                left[number] = light.light_here(number, world);
            }
            if (own) {
                show(most[number], dark ? 0.0 : light.light_shown(number, world));
            }
        }
        for (std::size_t number = lines.lights; spot.occlusion && number < lines.directions; ++number) {
            left[number] = light.open_here(number - lines.lights, world);
        }
        if (own && spot.occlusion && lit.plan.ambient_occlusion) {
            show(view.most_open(spot), light.open_shown(world));
        }
    });
    return lines;
}

} // namespace

bool LightErrorProbe::is_cheap(const LitView& lit) {
    std::size_t kernels = 0;
    for (const auto& field : lit.scene.fields) {
        kernels += as_regular(field.get()) != nullptr && !lit.plan.filter ? 0 : field->size();
    }
    return kernels <= most_scattered;
}

LightAtPoints LightErrorProbe::light_at(const LitView& lit, const LightVolumes& volumes,
                                        const std::shared_ptr<const LightVolume>& absorption) {
    std::vector<Known> known;
    std::vector<std::shared_ptr<const PointValues>> values;
    for (const auto& field : lit.scene.fields) {
        if (lit.plan.filter) {
            values.push_back(filtered_values(field, lit.scene, lit.camera, lit.size));
            continue;
        }
        const auto found =
            std::find_if(known_.begin(), known_.end(), [&](const Known& one) { return one.field == field; });
        known.push_back(found != known_.end() ? *found : Known{field, point_values(field, lit.scene)});
        values.push_back(known.back().values);
    }
    known_ = std::move(known);

    const BlocksOf blocks = [this, &volumes](const LightVolume& volume) -> const LightBlocks& {
        std::shared_ptr<const LightVolume> owner;
        for (const auto& group : volumes.groups) {
            owner = group.get() == &volume ? group : owner;
        }
        blocks_.erase(
            std::remove_if(blocks_.begin(), blocks_.end(), [](const auto& entry) { return entry.first.expired(); }),
            blocks_.end());
        for (const auto& [of, found] : blocks_) {
            if (of.lock() == owner) {
                return *found;
            }
        }
        blocks_.emplace_back(owner, std::make_unique<const LightBlocks>(volume));
        return *blocks_.back().second;
    };
    const ClearOf clear = [this, &absorption]() -> const ClearCells& {
        if (clear_.first.lock() != absorption) {
            clear_ = {absorption, std::make_unique<const ClearCells>(*absorption)};
        }
        return *clear_.second;
    };
    return LightAtPoints(lit, volumes, absorption.get(), blocks, clear, std::move(values));
}

std::vector<LightSpot> LightErrorProbe::spots(const LitView& lit, const std::vector<std::size_t>& numbers) {
    const LightAtPoints light = light_at(lit, *lit.scene.part->light, nullptr);
    const ProbePixels probes = probe_pixels(lit.size, light.surfaces());
    const ShownSpots view(lit, light);
    std::vector<std::vector<LightSpot>> found(numbers.size());
    ThreadPool pool(lit.threads);
    for_each(numbers.size(), pool, lit.progress, 0.0, [&](std::size_t task) {
        const auto [column, row] = probes.pixels.at(numbers[task]);
        found[task] = view.at(numbers[task], column, row);
    });
    std::vector<LightSpot> all;
    for (const std::vector<LightSpot>& one : found) {
        all.insert(all.end(), one.begin(), one.end());
    }
    return all;
}

LightLines LightErrorProbe::lines(const LitView& lit, const std::vector<LightSpot>& spots, std::size_t part) {
    const LightAtPoints light = light_at(lit, *lit.scene.part->light, nullptr);
    ThreadPool pool(lit.threads);
    return lines_from(spots, part, probe_pixels(lit.size, light.surfaces()), lit, light, ShownSpots(lit, light), pool,
                      0.0);
}

LightErrors LightErrorProbe::errors(const LitView& lit, const LightVolumes& volumes,
                                    const std::shared_ptr<const LightVolume>& absorption) {
    const LightAtPoints light = light_at(lit, volumes, absorption);
    // Where thin sheets of matter show, errors are at few pixels too.
    const ProbePixels probes = probe_pixels(lit.size, shows_surfaces(lit.scene.mode) || shows_narrowly(lit.scene));
    const ShownSpots view(lit, light);
    const std::size_t most = probes.pixels.size();
    ThreadPool pool(lit.threads);
    std::vector<std::vector<LightSpot>> found;
    std::size_t seen = 0;
    while (found.size() < most && seen < probes.wanted) {
        const std::size_t start = found.size();
        found.resize(std::min(most, start + probes.batch));
        for_each(found.size() - start, pool, lit.progress, 1.0, [&](std::size_t task) {
            const std::size_t number = start + task;
            const auto [column, row] = probes.pixels[number];
            // (All spots of all pixels would take much memory.)
            found[number] = choose_spots(view.at(number, column, row), probes.points, lit.scene.opacity_stop,
                                         probes.every_occlusion);
        });
        seen += static_cast<std::size_t>(std::count_if(found.begin() + static_cast<std::ptrdiff_t>(start), found.end(),
                                                       [](const auto& spots) { return !spots.empty(); }));
    }
    const std::size_t every = probes.every(seen);
    std::vector<LightSpot> chosen;
    for (const std::vector<LightSpot>& spots : found) {
        for (const LightSpot& spot : spots) {
            chosen.push_back(spot);
            chosen.back().occlusion = spot.number % every == 0;
        }
    }
    return light_errors(chosen, lines_from(chosen, 0, probes, lit, light, view, pool, 1.0), found.size(), every);
}

void state_light_errors(const LightErrors& errors, RenderPlan& plan) {
    for (ErrorShare& share : plan.error_budget) {
        if (share.effect == name_of(EffectId::shadows)) {
            share.rmse = errors.shadows;
        } else if (share.effect == name_of(EffectId::ambient_occlusion)) {
            share.rmse = errors.occlusion;
        }
    }
    charge_effects(plan);
}

} // namespace sheetsplat
