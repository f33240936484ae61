#include "view/field_view.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "plan/limits_common.hpp"

namespace sheetsplat {

Vec3 FieldView::eye_position(std::size_t i, std::size_t j, std::size_t k) const {
    Vec3 position =
        first_eye + static_cast<double>(i) * step_i + static_cast<double>(j) * step_j + static_cast<double>(k) * step_k;
    if (k % 2 == 1) {
        position += odd_layer;
    }
    return position;
}

FieldView make_field_view(const RegularField& field, const Camera& camera, const Frame& frame, Sampling sampling,
                          double value_unit, Filter filter) {
    FieldView view;
    double amplitude = 1.0;
    if (filter == Filter::none) {
        static_cast<LatticeSection&>(view) = lattice_section(field, camera);
    } else {
        // The deepest kernels are the widest.
        const ShapeRows rows = rows_of(field, camera);
        const FilterWidth width =
            filter_width(frame, field.kernel(),
                         frame.depth_of(std::max<std::int64_t>(frame.slices, 1) - 1) +
                             std::hypot(glm::length(rows.z), filter_width(frame, field.kernel(), 0.0).along));
        const WidenedShape shape = widened(rows, field.kernel_axes().lengths, width);
        static_cast<LatticeSection&>(view) = section_of(shape.rows);
        amplitude = shape.amplitude;
        if (frame.projection == Projection::perspective) {
            view.unfiltered = rows;
            amplitude = 1.0;
        }
    }
    view.field = &field;
    view.slab_half = sampling == Sampling::slab ? 0.5 * frame.slice_spacing : 0.0;
    view.first_eye = camera.to_eye(field.options().origin);
    const bool bcc = field.lattice() == Lattice::bcc;
    view.step_i = camera.direction_to_eye(field.steps()[0]);
    view.step_j = camera.direction_to_eye(field.steps()[1]);
    view.step_k = camera.direction_to_eye(field.steps()[2]);
    if (bcc) {
        view.odd_layer = 0.5 * (view.step_i + view.step_j);
    }

    const double gain = field.kernel().gain() * amplitude;
    view.weight_scale = std::max(gain, least_drawn_weight);
    view.value_scale = gain / value_unit;
    if (field.normalization() == Normalization::lattice) {
        view.value_scale /= field.lattice_constant();
    }
    return view;
}

} // namespace sheetsplat
