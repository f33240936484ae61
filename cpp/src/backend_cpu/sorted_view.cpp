#include "backend_cpu/sorted_view.hpp"

namespace sheetsplat::backend_cpu {

namespace {

/// Two frames that show kernels at the same places.
bool same_view(const Frame& a, const Frame& b) {
    return a.projection == b.projection && a.size.width == b.size.width && a.size.height == b.size.height &&
           a.pixel == b.pixel && a.axis_x == b.axis_x && a.axis_y == b.axis_y && a.slice_spacing == b.slice_spacing &&
           a.near == b.near && a.first_depth == b.first_depth && a.slices == b.slices;
}

bool same_place(const FieldView& a, const FieldView& b) {
    return a.field == b.field && a.first_eye == b.first_eye && a.step_i == b.step_i && a.step_j == b.step_j &&
           a.step_k == b.step_k && a.slab_half == b.slab_half && a.extent_x == b.extent_x && a.extent_y == b.extent_y &&
           a.half_depth == b.half_depth;
}

bool same_place(const EllipsoidView& a, const Vec3& eye, const Vec3& right, const Vec3& up) {
    return a.eye_world() == eye && a.right_world() == right && a.up_world() == up;
}

std::uint64_t beside_version(const EllipsoidPart& part) { return part.beside ? part.beside->visible_version : 0; }

std::vector<RowExtent> extents_of(const VisibleRuns& runs) {
    std::vector<RowExtent> rows(runs.rows());
    for (std::size_t row = 0; row < rows.size(); ++row) {
        if (runs.begin(row) != runs.end(row)) {
            rows[row] = {runs.begin(row)->begin, (runs.end(row) - 1)->end};
        }
    }
    return rows;
}

bool covers(const std::vector<RowExtent>& kept, const VisibleRuns& runs) {
    if (kept.size() != runs.rows()) {
        return false;
    }
    for (std::size_t row = 0; row < kept.size(); ++row) {
        if (runs.begin(row) != runs.end(row) &&
            (runs.begin(row)->begin < kept[row].begin || (runs.end(row) - 1)->end > kept[row].end)) {
            return false;
        }
    }
    return true;
}

} // namespace

SortedView SortedView::of(const Job& job, const TileLayout& layout, int edge, RectsFunction rects, ThreadPool& pool,
                          const std::function<void()>& poll) {
    SortedView view;
    view.frame = *job.frame;
    view.edge = edge;
    view.drawn = layout.drawn();
    view.sampling = job.plan->sampling;
    for (const RegularPart& part : job.regular) {
        view.lattices.push_back({job.scene->fields[part.field], *part.view, extents_of(*part.runs),
                                 bucket_rows(*part.view, *part.runs, *job.frame, layout, pool, poll)});
    }
    for (const EllipsoidPart& part : job.ellipsoids) {
        view.scattered.push_back({part.kernels, part.view->eye_world(), part.view->right_world(), part.view->up_world(),
                                  part.view->filtered(), part.visible_version, beside_version(part),
                                  bucket_kernels(*part.view, *part.visible, layout, rects, pool, poll)});
    }
    return view;
}

std::size_t SortedView::bytes() const {
    std::size_t sum = 0;
    for (const RowBuckets& part : lattices) {
        sum += part.parts.bytes() + part.rows.capacity() * sizeof(RowExtent);
    }
    for (const KernelBuckets& part : scattered) {
        sum += part.indices.bytes();
    }
    return sum;
}

bool SortedView::serves(const Job& job, const TileLayout& layout, int edge_now) const {
    if (edge != edge_now || drawn != layout.drawn() || !same_view(frame, *job.frame) ||
        sampling != job.plan->sampling || lattices.size() != job.regular.size() ||
        scattered.size() != job.ellipsoids.size()) {
        return false;
    }
    for (std::size_t part = 0; part < lattices.size(); ++part) {
        if (!same_place(lattices[part].view, *job.regular[part].view) ||
            !covers(lattices[part].rows, *job.regular[part].runs)) {
            return false;
        }
    }
    for (std::size_t part = 0; part < scattered.size(); ++part) {
        const KernelBuckets& kept = scattered[part];
        const EllipsoidPart& asked = job.ellipsoids[part];
        if (kept.kernels != asked.kernels || kept.filtered != asked.view->filtered() ||
            kept.visible_version != asked.visible_version || kept.beside_version != beside_version(asked) ||
            !same_place(*asked.view, kept.eye, kept.right, kept.up)) {
            return false;
        }
    }
    return true;
}

} // namespace sheetsplat::backend_cpu
