// rho of a field at any point of the world, in float64 from its kernels. Source: conventions, sections 2 and 3.
#pragma once

#include <memory>

#include "reference/reference.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/scene.hpp"

namespace sheetsplat {

class PointValues {
  public:
    struct Value {
        double rho = 0.0;
        bool empty = true; ///< no kernel reaches the point
    };

    /// least_weight: that of the field.
    explicit PointValues(double least_weight) : least_weight_(least_weight) {}
    PointValues(const PointValues&) = delete;
    PointValues& operator=(const PointValues&) = delete;
    virtual ~PointValues() = default;
    [[nodiscard]] Value at(const Vec3& world) const;
    /// What slab sampling shows of the line between two different points: the means of the sums, divided by each other.
    [[nodiscard]] Value mean(const Vec3& from, const Vec3& to) const;

  private:
    [[nodiscard]] virtual reference::Sums sums_at(const Vec3& world) const = 0;
    [[nodiscard]] virtual reference::Sums mean_sums(const Vec3& from, const Vec3& to) const = 0;
    [[nodiscard]] virtual double rho(const reference::Sums& sums) const = 0;

    double least_weight_;
};

/// Unfiltered. Samples of lattices are found where they are; of scattered kernels a grid is made. Throws OutOfMemory.
std::shared_ptr<const PointValues> point_values(const std::shared_ptr<const Field>& field, const Scene& scene);
/// With the kernels as the EWA filter widens them in one view.
std::shared_ptr<const PointValues> filtered_values(const std::shared_ptr<const Field>& field, const Scene& scene,
                                                   const Camera& camera, Size size);

} // namespace sheetsplat
