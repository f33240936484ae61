// What Python sees of plans.
#include <memory>

#include "convert.hpp"
#include "registrars.hpp"
#include "sheetsplat/render_plan.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {

namespace {

py::list backend_traits() {
    py::list all;
    for (const BackendTraits& traits : backend_table) {
        all.append(py::dict(py::arg("name") = traits.name, py::arg("defines") = can(traits.backend, Ability::defines),
                            py::arg("exact") = can(traits.backend, Ability::exact),
                            py::arg("ways") = can(traits.backend, Ability::ways),
                            py::arg("precisions") = py::tuple(py::str(traits.precisions).attr("split")()),
                            py::arg("pixels") = traits.pixels, py::arg("sections") = traits.sections,
                            py::arg("points") = traits.points, py::arg("rated_device") = traits.rated_device));
    }
    return all;
}

} // namespace

void register_plan(py::module_& module) {
    module.def("backend_traits", &backend_traits);
    py::class_<RenderPlan, std::shared_ptr<RenderPlan>>(module, "RenderPlan")
        .def_property_readonly("backend", [](const RenderPlan& plan) { return to_string(plan.backend); })
        .def_property_readonly("precision", [](const RenderPlan& plan) { return to_string(plan.precision); })
        .def_property_readonly("packing", [](const RenderPlan& plan) { return to_string(plan.packing); })
        .def_property_readonly("tagging", [](const RenderPlan& plan) { return to_string(plan.tagging); })
        .def_property_readonly("path", [](const RenderPlan& plan) { return to_string(plan.path); })
        .def_property_readonly("size",
                               [](const RenderPlan& plan) { return py::make_tuple(plan.size.width, plan.size.height); })
        .def_property_readonly("slice_spacing", [](const RenderPlan& plan) { return plan.slice_spacing; })
        .def_property_readonly("first_slice", [](const RenderPlan& plan) { return plan.first_slice; })
        .def_property_readonly("slices", [](const RenderPlan& plan) { return plan.slices; })
        .def_property_readonly("first_depth", [](const RenderPlan& plan) { return plan.first_depth; })
        .def_property_readonly("cut_by_near", [](const RenderPlan& plan) { return plan.cut_by_near; })
        .def_property_readonly("memory", [](const RenderPlan& plan) { return plan.memory; })
        .def_property_readonly("device", [](const RenderPlan& plan) { return plan.device; })
        .def_property_readonly(
            "effects",
            [](const RenderPlan& plan) {
                py::list effects;
                for (const Effect& effect : plan.effects) {
                    effects.append(py::make_tuple(effect.name, effect.on, effect.reason, effect.forced, effect.error));
                }
                return effects;
            })
        .def_property_readonly("expected_error", [](const RenderPlan& plan) { return plan.expected_error(); })
        .def_property_readonly("error_budget", [](const RenderPlan& plan) {
            py::list shares;
            for (const ErrorShare& share : plan.error_budget) {
                shares.append(py::make_tuple(share.cause, share.rmse));
            }
            return shares;
        });
    module.def("known_effects", [] {
        const auto names = [](const std::vector<Backend>& backends) {
            py::list all;
            for (const Backend backend : backends) {
                all.append(to_string(backend));
            }
            return all;
        };
        py::list effects;
        for (const EffectInfo& effect : known_effects()) {
            effects.append(py::make_tuple(effect.name, effect.meaning, effect.decided_by, names(effect.listed_by),
                                          names(effect.forcible_on)));
        }
        return effects;
    });
}

} // namespace sheetsplat::bindings
