// What Python sees of errors.
#include <new>
#include <stdexcept>
#include <string>
#include <variant>

#include <pybind11/gil_safe_call_once.h>

#include "convert.hpp"
#include "registrars.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

// The classes live as long as the interpreter, so that a translator that runs during its end finds them.
struct ErrorClasses {
    py::object error, invalid_input, device_unavailable, out_of_memory, unsupported, cancelled, words, option_ref;
};

PYBIND11_CONSTINIT py::gil_safe_call_once_and_store<ErrorClasses> error_classes;

ErrorClasses find_classes() {
    const auto errors = py::module_::import("sheetsplat.errors");
    return {errors.attr("Error"),       errors.attr("InvalidInput"), errors.attr("DeviceUnavailable"),
            errors.attr("OutOfMemory"), errors.attr("Unsupported"),  errors.attr("Cancelled"),
            errors.attr("Words"),       errors.attr("OptionRef")};
}

py::object python_words(const ErrorClasses& classes, const Words& words) {
    py::tuple pieces(words.pieces().size());
    for (std::size_t i = 0; i < words.pieces().size(); ++i) {
        const Words::Piece& piece = words.pieces()[i];
        const auto* option = std::get_if<OptionRef>(&piece);
        pieces[i] = option != nullptr ? classes.option_ref(option->name, option->value)
                                      : py::object(py::str(std::get<std::string>(piece)));
    }
    return classes.words(pieces);
}

void set_error(const ErrorClasses& classes, const py::object& kind, const Complaint& complaint) {
    const py::object option = complaint.option.empty() ? py::object(py::none()) : py::str(complaint.option);
    const auto words = [&](const Words& part) { return python_words(classes, part); };
    const py::object error =
        kind(words(complaint.what), words(complaint.found), words(complaint.wanted), words(complaint.advice), option);
    PyErr_SetObject(kind.ptr(), error.ptr());
}

Complaint too_large() {
    return {"the call cannot be completed", "not enough memory", "",
            "use a smaller volume or picture, or a narrower type of samples"};
}

} // namespace

void register_error() {
    error_classes.call_once_and_store_result(find_classes);
    py::register_local_exception_translator([](std::exception_ptr pointer) {
        if (!pointer) {
            return;
        }
        const ErrorClasses& known = error_classes.get_stored();
        try {
            std::rethrow_exception(pointer);
        } catch (const InvalidInput& error) {
            set_error(known, known.invalid_input, error.complaint());
        } catch (const DeviceUnavailable& error) {
            set_error(known, known.device_unavailable, error.complaint());
        } catch (const OutOfMemory& error) {
            set_error(known, known.out_of_memory, error.complaint());
        } catch (const Unsupported& error) {
            set_error(known, known.unsupported, error.complaint());
        } catch (const Cancelled& error) {
            set_error(known, known.cancelled, error.complaint());
        } catch (const Error& error) {
            set_error(known, known.error, error.complaint());
        } catch (const std::bad_alloc&) {
            set_error(known, known.out_of_memory, too_large());
        } catch (const std::length_error&) {
            // More than any memory has.
            set_error(known, known.out_of_memory, too_large());
        }
    });
}

} // namespace sheetsplat::bindings
