// What Python sees of lights, materials and light volumes.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <tuple>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/light_volume.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

using Values = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Volume = std::shared_ptr<const LightVolume>;

Vec3 vec3_of(const py::handle& object) { return to_vec3(object.cast<Triple>()); }

py::tuple state_of(const LightGrid& grid) {
    return py::make_tuple(grid.wanted, grid.step, grid.spacing, grid.every, to_triple(grid.first), grid.size.width,
                          grid.size.height, grid.slices, grid.shows_matter);
}

LightGrid grid_of(const py::tuple& state) {
    LightGrid grid;
    grid.wanted = state[0].cast<double>();
    grid.step = state[1].cast<double>();
    grid.spacing = state[2].cast<double>();
    grid.every = state[3].cast<int>();
    grid.first = vec3_of(state[4]);
    grid.size = {state[5].cast<int>(), state[6].cast<int>()};
    grid.slices = state[7].cast<std::int64_t>();
    grid.shows_matter = state[8].cast<bool>();
    return grid;
}

py::tuple state_of(const LightPlan& plan) {
    py::list grids, lights;
    for (const LightGrid& grid : plan.grids) {
        grids.append(state_of(grid));
    }
    for (const Vec3& light : plan.lights) {
        lights.append(to_triple(light));
    }
    return py::make_tuple(plan.slice_spacing, plan.surfaces, grids, lights, plan.light_grid, plan.radius,
                          plan.open_grid, plan.open_is_halved);
}

LightPlan plan_of(const py::tuple& state) {
    LightPlan plan;
    plan.slice_spacing = state[0].cast<double>();
    plan.surfaces = state[1].cast<bool>();
    for (const py::handle grid : state[2]) {
        plan.grids.push_back(grid_of(grid.cast<py::tuple>()));
    }
    for (const py::handle light : state[3]) {
        plan.lights.push_back(vec3_of(light));
    }
    plan.light_grid = state[4].cast<std::size_t>();
    plan.radius = state[5].cast<double>();
    plan.open_grid = state[6].cast<std::size_t>();
    plan.open_is_halved = state[7].cast<bool>();
    return plan;
}

/// None for a null one. The array keeps all volumes alive.
py::object state_of(const Volume& volume, const std::shared_ptr<LightVolumes>& all) {
    if (!volume) {
        return py::none();
    }
    const auto& [u, v, w] = volume->per_step;
    const auto& [columns, rows, planes] = volume->counts;
    return py::make_tuple(to_triple(volume->origin), py::make_tuple(to_triple(u), to_triple(v), to_triple(w)),
                          py::array_t<float>({planes, rows, columns}, volume->values.data(), py::cast(all)));
}

Volume volume_of(const py::handle& object) {
    if (object.is_none()) {
        return nullptr;
    }
    const auto state = object.cast<py::tuple>();
    const auto steps = state[1].cast<py::tuple>();
    const auto values = state[2].cast<Values>();
    LightVolume volume;
    volume.origin = vec3_of(state[0]);
    volume.per_step = {vec3_of(steps[0]), vec3_of(steps[1]), vec3_of(steps[2])};
    volume.counts = {static_cast<int>(values.shape(2)), static_cast<int>(values.shape(1)),
                     static_cast<int>(values.shape(0))};
    volume.values.assign(values.data(), values.data() + values.size());
    return std::make_shared<const LightVolume>(std::move(volume));
}

py::tuple state_of(const std::shared_ptr<LightVolumes>& volumes) {
    py::list lights, groups;
    for (const Volume& light : volumes->lights) {
        lights.append(state_of(light, volumes));
    }
    for (const Volume& group : volumes->groups) {
        groups.append(state_of(group, volumes));
    }
    return py::make_tuple(lights, state_of(volumes->openness, volumes), groups);
}

std::shared_ptr<LightVolumes> volumes_of(const py::tuple& state) {
    auto volumes = std::make_shared<LightVolumes>();
    for (const py::handle light : state[0]) {
        volumes->lights.push_back(volume_of(light));
    }
    volumes->openness = volume_of(state[1]);
    for (const py::handle group : state[2]) {
        volumes->groups.push_back(volume_of(group));
    }
    return volumes;
}

std::size_t bytes_of(const LightVolumes& volumes) {
    std::size_t bytes = volumes.openness ? volumes.openness->bytes() : 0;
    for (const auto* several : {&volumes.lights, &volumes.groups}) {
        for (const Volume& one : *several) {
            bytes += one ? one->bytes() : 0;
        }
    }
    return bytes;
}

/// (planes, rows, columns) of each grid.
std::vector<std::tuple<int, int, int>> grid_shapes_of(const LightPlan& plan) {
    std::vector<std::tuple<int, int, int>> shapes;
    for (const LightGrid& grid : plan.grids) {
        const auto [columns, rows, planes] = grid.counts(plan.surfaces);
        shapes.emplace_back(planes, rows, columns);
    }
    return shapes;
}

/// Largest distance of neighbouring elements, world units; 0 without grids.
double step_of(const LightPlan& plan) {
    double step = 0.0;
    for (const LightGrid& grid : plan.grids) {
        step = std::max({step, grid.step, grid.spacing * grid.every});
    }
    return step;
}

} // namespace

void register_light(py::module_& module) {
    py::class_<LightPlan>(module, "LightPlan")
        .def_property_readonly("shapes", &grid_shapes_of)
        .def_property_readonly("step", &step_of)
        .def(py::pickle([](const LightPlan& plan) { return state_of(plan); }, &plan_of));
    py::class_<LightVolumes, std::shared_ptr<LightVolumes>>(module, "LightVolumes")
        .def(py::init<>())
        .def_property_readonly("nbytes", &bytes_of)
        .def(py::pickle([](const std::shared_ptr<LightVolumes>& volumes) { return state_of(volumes); }, &volumes_of));
}

} // namespace sheetsplat::bindings
