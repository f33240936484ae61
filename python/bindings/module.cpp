// The native half of the Python package. The public classes are in python/sheetsplat and hold what is registered here.
#include "registrars.hpp"
#include "released.hpp"

PYBIND11_MODULE(_sheetsplat, module) {
    module.doc() = "Native half of sheetsplat; use the names of the package itself.";
    module.attr("__version__") = SHEETSPLAT_VERSION;
    using namespace sheetsplat::bindings;
    register_error();
    register_field(module);
    register_transfer_function(module);
    register_light(module);
    register_scene(module);
    register_camera(module);
    register_plan(module);
    register_image(module);
    register_renderer(module);
    register_descent(module);
    register_device(module);
    register_ellipsoid_fit(module);
    Released::prepare_for_the_end();
}
