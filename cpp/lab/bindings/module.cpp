// The module _sheetsplat_lab: pictures by comparators and the fill test, for benchmarks and tests. Scenes, cameras,
// plans and images are the classes of sheetsplat._sheetsplat, which must be imported first. It holds a library of its
// own, so that a Renderer of either module is no Renderer of the other.
#include <memory>
#include <optional>

#include <pybind11/functional.h>

#include "convert.hpp"
#include "lab/comparators.hpp"
#include "lab/fill_test.hpp"
#include "registrars.hpp"

namespace py = pybind11;

namespace sheetsplat::lab {
namespace {

template <class Enum, std::size_t count>
Enum named(const char* what, const std::string& name, const std::array<Enum, count>& values) {
    std::map<std::string, Enum> names;
    for (const Enum value : values) {
        names[to_string(value)] = value;
    }
    return bindings::from_name(what, name, names);
}

RendererOptions options_of(std::optional<int> device, const std::string& precision, const std::string& tagging,
                           const std::string& packing, const std::string& path,
                           const std::map<std::string, bool>& effects, bool allow_inexact, int tile_size,
                           int tags_per_clear) {
    RendererOptions options;
    options.backend = Backend::gl;
    options.device = device;
    options.precision =
        named("precision", precision,
              std::array{Precision::automatic, Precision::uint8, Precision::float16, Precision::float32});
    options.tagging = named(
        "tagging", tagging,
        std::array{Tagging::automatic, Tagging::depth_bounds, Tagging::depth_equal, Tagging::tiles, Tagging::off});
    options.packing = named("packing", packing, std::array{Packing::automatic, Packing::paper, Packing::wide});
    options.path = named("path", path, std::array{Path::automatic, Path::raster, Path::compute});
    options.effects = effects;
    options.allow_inexact = allow_inexact;
    options.tile_size = tile_size;
    options.tags_per_clear = tags_per_clear;
    return options;
}

/// One thread at a time.
class LabRenderer {
  public:
    LabRenderer(const std::vector<std::string>& comparators, const RendererOptions& options)
        : comparators_(comparators_of(comparators)), renderer_(options) {}

    std::shared_ptr<RenderPlan> plan(const Scene& scene, const Camera& camera, std::array<int, 2> size, bool coverage,
                                     bool depth) {
        return std::make_shared<RenderPlan>(renderer_.plan(scene, camera, {size[0], size[1]}, {coverage, depth}));
    }
    std::shared_ptr<Image> render(const Scene& scene, const Camera& camera, std::array<int, 2> size, bool coverage,
                                  bool depth, const std::function<py::object(double)>& progress) {
        Progress watch;
        if (progress) {
            watch = [&](double share) {
                const py::gil_scoped_acquire acquire;
                return !progress(share).is(py::bool_(false));
            };
        }
        const py::gil_scoped_release release;
        return std::make_shared<Image>(
            lab::render(renderer_, comparators_, scene, camera, {size[0], size[1]}, {coverage, depth}, watch));
    }

  private:
    Comparators comparators_;
    Renderer renderer_;
};

} // namespace

PYBIND11_MODULE(_sheetsplat_lab, module) {
    bindings::register_error();
    module.doc() = "Other ways of drawing, to be compared with sheetsplat's own.";
    module.attr("COMPARATORS") = py::tuple(py::cast(comparator_names()));
    py::class_<LabRenderer>(module, "Renderer")
        .def(py::init([](const std::vector<std::string>& comparators, std::optional<int> device,
                         const std::string& precision, const std::string& tagging, const std::string& packing,
                         const std::string& path, const std::map<std::string, bool>& effects, bool allow_inexact,
                         int tile_size, int tags_per_clear) {
                 return std::make_unique<LabRenderer>(comparators,
                                                      options_of(device, precision, tagging, packing, path, effects,
                                                                 allow_inexact, tile_size, tags_per_clear));
             }),
             py::arg("comparators"), py::kw_only(), py::arg("device") = py::none(), py::arg("precision") = "auto",
             py::arg("tagging") = "auto", py::arg("packing") = "auto", py::arg("path") = "raster",
             py::arg("effects") = std::map<std::string, bool>{}, py::arg("allow_inexact") = false,
             py::arg("tile_size") = 0, py::arg("tags_per_clear") = 0)
        .def("plan", &LabRenderer::plan, py::arg("scene"), py::arg("camera"), py::kw_only(), py::arg("size"),
             py::arg("coverage") = false, py::arg("depth") = false, py::call_guard<py::gil_scoped_release>())
        .def("render", &LabRenderer::render, py::arg("scene"), py::arg("camera"), py::kw_only(), py::arg("size"),
             py::arg("coverage") = false, py::arg("depth") = false, py::arg("progress") = py::none());
    module.def(
        "fill_test",
        [](std::size_t kernels, double diameter_px, int width, int height, int targets, int repeats) {
            Seconds seconds;
            {
                const py::gil_scoped_release released;
                seconds = fill_test(kernels, diameter_px, width, height, targets, repeats);
            }
            return py::make_tuple(seconds.wall, seconds.cpu);
        },
        py::arg("kernels"), py::arg("diameter_px"), py::arg("width"), py::arg("height"), py::arg("targets") = 1,
        py::arg("repeats") = 5);
}

} // namespace sheetsplat::lab
