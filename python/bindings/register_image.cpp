// What Python sees of pictures.
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/image.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

/// A channel without a copy: the array keeps the image alive. None where the image does not have it.
template <std::vector<float> Image::*channel, py::ssize_t values>
py::object view_channel(const py::object& self) {
    auto& image = self.cast<Image&>();
    std::vector<float>& pixels = image.*channel;
    if (pixels.empty()) {
        return py::none();
    }
    std::vector<py::ssize_t> shape{image.size.height, image.size.width};
    if (values > 1) {
        shape.push_back(values);
    }
    return py::array(py::dtype::of<float>(), shape, pixels.data(), self);
}

py::object view_map(const py::object& self) {
    auto& estimate = self.cast<ErrorEstimate&>();
    const std::vector<py::ssize_t> shape{estimate.size.height, estimate.size.width};
    return py::array(py::dtype::of<float>(), shape, estimate.map.data(), self);
}

py::object settings_of(const Image& image) {
    if (!image.settings) {
        return py::none();
    }
    const Settings& settings = *image.settings;
    py::dict result;
    result["slice_spacing"] = settings.slice_spacing;
    result["sampling"] = settings.sampling == Sampling::slab ? "slab" : "point";
    result["preintegration"] = settings.preintegration;
    result["second_order"] = settings.second_order;
    result["opacity_stop"] = settings.opacity_stop;
    result["precision"] = to_string(settings.precision);
    return std::move(result);
}

using Floats = py::array_t<float, py::array::c_style>;

py::dict compare_arrays(const Floats& picture, const Floats& reference, int channels) {
    const std::vector<float> a(picture.data(), picture.data() + picture.size());
    const std::vector<float> b(reference.data(), reference.data() + reference.size());
    Difference difference;
    {
        const Released release;
        difference = compare(a, b, channels);
    }
    py::dict result;
    result["rmse"] = difference.rmse;
    result["p99_9"] = difference.p99_9;
    result["maximum"] = difference.maximum;
    return result;
}

using Pixels = py::array_t<float, py::array::c_style | py::array::forcecast>;

/// A picture of an array: (h, w, 4), or (h, w) in scalar modes.
Image image_of(const Pixels& pixels) {
    if (pixels.ndim() != 3 && pixels.ndim() != 2) {
        throw std::invalid_argument("a picture of neither (h, w, 4) nor (h, w) numbers");
    }
    Image image;
    image.size = {static_cast<int>(pixels.shape(1)), static_cast<int>(pixels.shape(0))};
    (pixels.ndim() == 3 ? image.rgba : image.scalar).assign(pixels.data(), pixels.data() + pixels.size());
    return image;
}

ErrorEstimate estimate_of_arrays(const Pixels& drawn, const Pixels& exact, const std::optional<Pixels>& unstopped,
                                 const Pixels& halved, const Pixels& doubled, const std::string& mode, bool preintegration,
                                 const std::vector<std::tuple<std::string, double, std::string>>& budget) {
    const Image pictures[] = {image_of(drawn), image_of(exact), unstopped ? image_of(*unstopped) : Image{},
                              image_of(halved), image_of(doubled)};
    std::vector<ErrorShare> shares;
    for (const auto& [cause, rmse, effect] : budget) {
        shares.push_back({cause, rmse, effect});
    }
    return estimate_error({&pictures[0], &pictures[1], unstopped ? &pictures[2] : nullptr, &pictures[3], &pictures[4]},
                          from_name("mode", mode, modes), preintegration, shares);
}

} // namespace

void register_image(py::module_& module) {
    py::class_<Image, std::shared_ptr<Image>>(module, "Image")
        .def_property_readonly("size",
                               [](const Image& image) { return py::make_tuple(image.size.width, image.size.height); })
        .def_property_readonly("rgba", &view_channel<&Image::rgba, 4>)
        .def_property_readonly("scalar", &view_channel<&Image::scalar, 1>)
        .def_property_readonly("coverage", &view_channel<&Image::coverage, 1>)
        .def_property_readonly("depth", &view_channel<&Image::depth, 1>)
        .def_property_readonly("counts", &view_channel<&Image::counts, 1>)
        .def_property_readonly("plan",
                               [](const Image& image) { return std::const_pointer_cast<RenderPlan>(image.plan); })
        .def_property_readonly("stats", [](const Image& image) { return image.stats; })
        .def_property_readonly("settings", &settings_of)
        .def("save_png", &save_png, py::arg("path"), py::call_guard<Released>())
        .def("save_pfm", &save_pfm, py::arg("path"), py::call_guard<Released>());
    py::class_<ErrorEstimate, std::shared_ptr<ErrorEstimate>>(module, "ErrorEstimate")
        .def_property_readonly("rmse", [](const ErrorEstimate& estimate) { return estimate.rmse; })
        .def_property_readonly("budget",
                               [](const ErrorEstimate& estimate) {
                                   py::list shares;
                                   for (const ErrorShare& share : estimate.budget) {
                                       shares.append(py::make_tuple(share.cause, share.rmse));
                                   }
                                   return shares;
                               })
        .def_property_readonly("map", &view_map);
    module.def("estimate_error", &estimate_of_arrays, py::arg("drawn"), py::arg("exact"), py::arg("unstopped"),
               py::arg("halved"), py::arg("doubled"), py::kw_only(), py::arg("mode"), py::arg("preintegration"), py::arg("budget"));
    module.def("compare", &compare_arrays, py::arg("picture"), py::arg("reference"), py::arg("channels"));
}

} // namespace sheetsplat::bindings
