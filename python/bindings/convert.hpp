// Conversions that several nouns share.
#pragma once

#include <array>
#include <map>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "sheetsplat/error.hpp"
#include "sheetsplat/scene.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat::bindings {

inline const std::map<std::string, Mode> modes{{"composite", Mode::composite}, {"isosurface", Mode::isosurface},
                                               {"xray", Mode::xray},           {"mip", Mode::mip},
                                               {"minimum", Mode::minimum},     {"average", Mode::average}};

using Triple = std::array<double, 3>;

inline Vec3 to_vec3(const Triple& triple) { return {triple[0], triple[1], triple[2]}; }
inline std::tuple<double, double, double> to_triple(const Vec3& vector) { return {vector.x, vector.y, vector.z}; }
inline auto to_corners(const Box& box) { return std::make_pair(to_triple(box.lower), to_triple(box.upper)); }

/// The value that `name` stands for; InvalidInput that lists the names otherwise.
template <typename Value>
Value from_name(const std::string& what, const std::string& name, const std::map<std::string, Value>& values) {
    const auto found = values.find(name);
    if (found != values.end()) {
        return found->second;
    }
    std::ostringstream wanted;
    const char* separator = "";
    for (const auto& entry : values) {
        wanted << separator << entry.first;
        separator = ", ";
    }
    throw InvalidInput(Complaint{option_ref(what) + " cannot be used", "\"" + name + "\"", "one of: " + wanted.str()});
}

} // namespace sheetsplat::bindings
