#include <new>
#include <string>

#include <pybind11/gil_safe_call_once.h>

#include "convert.hpp"
#include "registrars.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

// The classes live as long as the interpreter, so that a translator that runs during its end finds them.
struct ErrorClasses {
    py::object error, invalid_input, device_unavailable, out_of_memory, unsupported, cancelled;
};

PYBIND11_CONSTINIT py::gil_safe_call_once_and_store<ErrorClasses> error_classes;

py::object make_class(const char* name, const char* doc, const py::tuple& bases) {
    const std::string qualified = std::string("sheetsplat.") + name;
    PyObject* made = PyErr_NewExceptionWithDoc(qualified.c_str(), doc, bases.ptr(), nullptr);
    if (made == nullptr) {
        throw py::error_already_set();
    }
    return py::reinterpret_steal<py::object>(made);
}

ErrorClasses make_classes() {
    ErrorClasses classes;
    const auto builtin = [](PyObject* type) { return py::reinterpret_borrow<py::object>(type); };
    classes.error = make_class("Error", "Base of all errors that sheetsplat raises on purpose.",
                               py::make_tuple(builtin(PyExc_Exception)));
    classes.invalid_input =
        make_class("InvalidInput", "A number, an array, a file or an option that has no meaning here.",
                   py::make_tuple(classes.error, builtin(PyExc_ValueError)));
    classes.device_unavailable =
        make_class("DeviceUnavailable", "No device for the backend could be had; the message lists every try.",
                   py::make_tuple(classes.error, builtin(PyExc_RuntimeError)));
    classes.out_of_memory =
        make_class("OutOfMemory", "More memory would be needed than there is; nothing was left allocated.",
                   py::make_tuple(classes.error, builtin(PyExc_RuntimeError)));
    classes.unsupported =
        make_class("Unsupported", "A sensible request that cannot be fulfilled here within its error bound.",
                   py::make_tuple(classes.error, builtin(PyExc_RuntimeError)));
    classes.cancelled = make_class("Cancelled", "The progress callback returned False; the renderer stays usable.",
                                   py::make_tuple(classes.error));
    return classes;
}

} // namespace

void register_error(py::module_& module) {
    const ErrorClasses& classes = error_classes.call_once_and_store_result(make_classes).get_stored();
    module.attr("Error") = classes.error;
    module.attr("InvalidInput") = classes.invalid_input;
    module.attr("DeviceUnavailable") = classes.device_unavailable;
    module.attr("OutOfMemory") = classes.out_of_memory;
    module.attr("Unsupported") = classes.unsupported;
    module.attr("Cancelled") = classes.cancelled;

    py::register_local_exception_translator([](std::exception_ptr pointer) {
        if (!pointer) {
            return;
        }
        const ErrorClasses& known = error_classes.get_stored();
        try {
            std::rethrow_exception(pointer);
        } catch (const InvalidInput& error) {
            py::set_error(known.invalid_input, error.what());
        } catch (const DeviceUnavailable& error) {
            py::set_error(known.device_unavailable, error.what());
        } catch (const OutOfMemory& error) {
            py::set_error(known.out_of_memory, error.what());
        } catch (const Unsupported& error) {
            py::set_error(known.unsupported, error.what());
        } catch (const Cancelled& error) {
            py::set_error(known.cancelled, error.what());
        } catch (const Error& error) {
            py::set_error(known.error, error.what());
        } catch (const std::bad_alloc&) {
            const Complaint complaint{"memory could not be had", "", "",
                                      "use a smaller volume or picture, or a narrower type of samples"};
            py::set_error(known.out_of_memory, complaint.text().c_str());
        }
    });

    module.def(
        "complaint_text",
        [](const std::string& failed, const std::string& found, const std::string& wanted, const std::string& next) {
            return Complaint{failed, found, wanted, next}.text();
        },
        py::arg("failed"), py::arg("found"), py::arg("wanted"), py::arg("next"),
        "The four parts of a message as one text, as the C++ side writes it.");
}

} // namespace sheetsplat::bindings
