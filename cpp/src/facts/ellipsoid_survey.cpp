#include "facts/ellipsoid_survey.hpp"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "base/poll.hpp"

namespace sheetsplat {

namespace {

constexpr double pi = 3.14159265358979323846;
/// Kernels larger than this are resolved, and it does not matter how large they are.
constexpr double plainly_resolved_px = 1.0;

double shortest_axis(const EllipsoidField& field, std::size_t kernel) {
    const Vec3 axes = field.semi_axes(kernel);
    return std::min({axes.x, axes.y, axes.z});
}

} // namespace

KernelFacts survey_kernels(const EllipsoidField& field) {
    KernelFacts facts;
    if (field.size() == 0) {
        return facts;
    }
    facts.thinnest = std::numeric_limits<double>::infinity();
    facts.thickest = 0.0;
    const Vec3 box = field.supports_world().extent();
    double filled = 0.0;
    for (std::size_t i = 0; i < field.size(); ++i) {
        poll_at(i);
        const Vec3 axes = field.semi_axes(i);
        const double shortest = std::min({axes.x, axes.y, axes.z});
        facts.largest_aspect = std::max(facts.largest_aspect, std::max({axes.x, axes.y, axes.z}) / shortest);
        facts.thinnest = std::min(facts.thinnest, shortest);
        facts.thickest = std::max(facts.thickest, shortest);
        filled += (axes.x / box.x) * (axes.y / box.y) * (axes.z / box.z);
    }
    facts.mean_overlap = 4.0 / 3.0 * pi * filled;
    facts.crowd = survey_crowd(field);
    return facts;
}

EllipsoidFacts survey_ellipsoids(const EllipsoidField& field, const KernelFacts& kernels, const Camera& camera,
                                 const Frame& frame) {
    EllipsoidFacts facts;
    if (field.size() == 0) {
        return facts;
    }
    const bool perspective = frame.projection == Projection::perspective;
    double widest = frame.pixel, farthest = 0.0;
    if (perspective) {
        // Depth of the farthest corner of the centres' box, before or behind the eye.
        const Box box = field.centres_world();
        const Vec3 back = camera.back_world();
        const double middle = glm::dot(box.centre() - camera.eye(), back);
        const double half = 0.5 * glm::dot(box.extent(), glm::abs(back));
        farthest = std::abs(middle) + half;
        widest *= farthest;
    }
    const double coarsest = std::max(widest, frame.slice_spacing);
    const FilterWidth width = filter_width(frame, field.kernel(), farthest);
    const double widening = std::max(width.across, width.along);
    facts.largest_change = widening * widening / (kernels.thinnest * kernels.thinnest);
    facts.smallest_px = kernels.thinnest / widest;
    // A section spans the kernel both ways: below half a pixel or slice distance of radius it may fall between two.
    if (2.0 * kernels.thinnest >= coarsest) {
        return facts;
    }
    if (!perspective && 2.0 * kernels.thickest < coarsest) {
        facts.unresolved = field.size();
        return facts;
    }
    const bool measure = perspective && facts.smallest_px < plainly_resolved_px;
    facts.smallest_px = measure ? std::numeric_limits<double>::infinity() : facts.smallest_px;
    for (std::size_t i = 0; i < field.size(); ++i) {
        poll_at(i);
        const double shortest = shortest_axis(field, i);
        double pixel = frame.pixel;
        if (perspective) {
            pixel *= std::abs(glm::dot(field.center(i) - camera.eye(), camera.back_world()));
        }
        facts.unresolved += 2.0 * shortest < std::max(pixel, frame.slice_spacing) ? 1 : 0;
        if (measure && shortest < facts.smallest_px * pixel) {
            facts.smallest_px = shortest / pixel;
        }
    }
    return facts;
}

} // namespace sheetsplat
