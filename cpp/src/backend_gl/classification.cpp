#include "classification.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "interop.h"

namespace sheetsplat::backend_gl {

Classification::Classification(const gl::Api& gl, const TransferFunction& function, double value_unit, double origin) {
    const auto& points = function.points();
    const auto count = static_cast<int>(points.size());
    last_ = count - 1;
    std::vector<float> texels(static_cast<std::size_t>(count) * 8, 0.0F);
    std::vector<float> values(points.size());
    for (std::size_t p = 0; p < points.size(); ++p) {
        values[p] = static_cast<float>((points[p].value - origin) / value_unit);
    }
    for (std::size_t p = 0; p < points.size(); ++p) {
        float* row0 = texels.data() + 4 * p;
        row0[0] = static_cast<float>(points[p].color.x);
        row0[1] = static_cast<float>(points[p].color.y);
        row0[2] = static_cast<float>(points[p].color.z);
        row0[3] = static_cast<float>(points[p].opacity);
        float* row1 = texels.data() + 4 * (points.size() + p);
        row1[0] = values[p];
        row1[1] = p + 1 < points.size() ? values[p + 1] : std::numeric_limits<float>::max();
        row1[2] = row1[1] > row1[0] ? 1.0F / (row1[1] - row1[0]) : 0.0F;
    }
    points_ = gl::Texture(gl, GL_RGBA32F, count, 2);
    points_.upload(GL_RGBA, GL_FLOAT, texels.data());

    first_ = values.front();
    const float span = values.back() - values.front();
    cells_per_unit_ = span > 0.0F ? static_cast<float>(TRANSFER_CELLS) / span : 0.0F;
    std::vector<std::int32_t> cells(TRANSFER_CELLS, 0);
    for (std::size_t cell = 0; cell < cells.size(); ++cell) {
        // A cell's start as the shader may round it: one rounding too low is made up for by the shader's walk upwards.
        const float start = first_ +
                            span * (static_cast<float>(cell) / static_cast<float>(TRANSFER_CELLS)) * (1.0F - 1e-6F) -
                            span * 1e-6F;
        const auto after = std::upper_bound(values.begin(), values.end(), start);
        cells[cell] = static_cast<std::int32_t>(std::max<std::ptrdiff_t>(after - values.begin() - 1, 0));
    }
    if (span == 0.0F) {
        std::fill(cells.begin(), cells.end(), last_);
    }
    index_ = gl::Texture(gl, GL_R32I, TRANSFER_CELLS, 1);
    index_.upload(GL_RED_INTEGER, GL_INT, cells.data());
}

void Classification::bind(const gl::Program& program) const {
    program.bind("transfer_index", index_, UNIT_TRANSFER_INDEX);
    program.bind("transfer_points", points_, UNIT_TRANSFER_POINTS);
    program.set("transfer_range", first_, cells_per_unit_);
    program.set("transfer_last", last_);
}

} // namespace sheetsplat::backend_gl
