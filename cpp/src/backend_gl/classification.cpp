#include "classification.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "interop.h"

namespace sheetsplat::backend_gl {

Classification::Classification(const gl::Api& gl, const std::vector<Part>& parts) {
    std::size_t width = 0;
    for (const Part& part : parts) {
        width = std::max(width, part.function->points().size());
    }
    std::vector<float> texels(width * 8 * parts.size(), 0.0F);
    std::vector<std::int32_t> cells(TRANSFER_CELLS * parts.size(), 0);
    for (std::size_t number = 0; number < parts.size(); ++number) {
        const auto& points = parts[number].function->points();
        std::vector<float> values(points.size());
        for (std::size_t p = 0; p < points.size(); ++p) {
            values[p] = static_cast<float>((points[p].value - parts[number].origin) / parts[number].value_unit);
        }
        for (std::size_t p = 0; p < points.size(); ++p) {
            float* row0 = texels.data() + 4 * (2 * number * width + p);
            row0[0] = static_cast<float>(points[p].color.x);
            row0[1] = static_cast<float>(points[p].color.y);
            row0[2] = static_cast<float>(points[p].color.z);
            row0[3] = static_cast<float>(points[p].opacity);
            float* row1 = row0 + 4 * width;
            row1[0] = values[p];
            row1[1] = p + 1 < points.size() ? values[p + 1] : std::numeric_limits<float>::max();
            row1[2] = row1[1] > row1[0] ? 1.0F / (row1[1] - row1[0]) : 0.0F;
        }
        const float first = values.front();
        const float span = values.back() - first;
        const auto last = static_cast<std::int32_t>(points.size()) - 1;
        ranges_.push_back({first, span > 0.0F ? static_cast<float>(TRANSFER_CELLS) / span : 0.0F, last});
        for (std::size_t cell = 0; cell < TRANSFER_CELLS; ++cell) {
            // A cell's start as the shader may round it: one rounding too low is made up for by the shader's walk
            // upwards.
            const float start =
                first + span * (static_cast<float>(cell) / static_cast<float>(TRANSFER_CELLS)) * (1.0F - 1e-6F) -
                span * 1e-6F;
            const auto after = std::upper_bound(values.begin(), values.end(), start);
            cells[number * TRANSFER_CELLS + cell] =
                span == 0.0F ? last
                             : static_cast<std::int32_t>(std::max<std::ptrdiff_t>(after - values.begin() - 1, 0));
        }
    }
    points_ = gl::Texture(gl, GL_RGBA32F, static_cast<int>(width), 2 * static_cast<int>(parts.size()));
    points_.upload(GL_RGBA, GL_FLOAT, texels.data());
    index_ = gl::Texture(gl, GL_R32I, TRANSFER_CELLS, static_cast<int>(parts.size()));
    index_.upload(GL_RED_INTEGER, GL_INT, cells.data());
}

void Classification::bind(const gl::Program& program) const {
    program.bind("transfer_index", index_, UNIT_TRANSFER_INDEX);
    program.bind("transfer_points", points_, UNIT_TRANSFER_POINTS);
    for (std::size_t number = 0; number < ranges_.size(); ++number) {
        const Range& range = ranges_[number];
        const std::string element = ranges_.size() > 1 ? "s[" + std::to_string(number) + "]" : "";
        program.set("transfer_range" + element, range.first, range.cells_per_unit);
        program.set("transfer_last" + element, range.last);
    }
}

} // namespace sheetsplat::backend_gl
