// Everything that turns finished slices into a picture, made once a frame in the number format of the sheets from
// view/shading_inputs: the transfer function, lights, material, scales. Source: conventions, sections 4 to 7.
#pragma once

#include <optional>
#include <vector>

#include <glm/mat3x3.hpp>

#include "backend_cpu/surface_table.hpp"
#include "backend_cpu/transfer_table.hpp"
#include "facts/frame.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/camera.hpp"
#include "sheetsplat/light_volume.hpp"
#include "sheetsplat/scene.hpp"
#include "view/half_spaces.hpp"
#include "view/shading_inputs.hpp"

namespace sheetsplat {
struct DrawPlan;
}

namespace sheetsplat::backend_cpu {

/// A directional light, with what the material makes of it.
template <class T>
struct ShadingLight {
    T direction[3] = {}; ///< eye space, unit length, towards the light
    T diffuse[3] = {};   ///< colour times diffuse coefficient
    T specular[3] = {};  ///< colour times specular coefficient
};

/// A lattice whose kernels are summed at single points. Kernels are spheres in units of the samples.
struct PointLattice {
    /// Of an axis, that a kernel may reach a point from.
    static constexpr int most_samples = 8;
    const RegularField* field = nullptr;
    Vec3 first_eye{0.0};       ///< of sample (0, 0, 0)
    glm::dmat3 to_index{1.0};  ///< from eye space
    double radius = 2.0;       ///< in samples
    double falloff_log2 = 0.0; ///< k log2(e), over the square of the radius
    double edge = 0.0;         ///< exp(-k)
    double counted_from = 0.0;
    double value_scale = 1.0;
};

/// By what a group of fields is classified.
template <class T>
struct GroupShading {
    TransferTable<T> transfer;
    RampTable<T> ramps;                           ///< preintegration only
    std::vector<ShadingSurface<T>> surfaces;      ///< mode isosurface only: those that show
    SurfaceTable<T> surface_table;                ///< of these
    double weakest_gradient = 0.0;                ///< g0
    double full_gradient = 1.0;                   ///< g1
    T least_weight = 0, base = 0;                 ///< ShadingInputs::OfGroup
    std::vector<KeptHalfSpace> kept;              ///< where its fields end, if other groups' do not end there
    bool classified = true;                       ///< else its rho is there for other groups
    bool counts = true;                           ///< its weights are part of the coverage
    bool at_zero = true;                          ///< something may show at points and in intervals of 0
    GroupRange colors;                            ///< the groups whose colours take the place of its own
    std::optional<PointLattice> summed_at_points; ///< its rho is asked for at single points: it has no sheets
};

/// How much of the light from somewhere reaches a point: a number between 0 and 1 in a LightVolume. The places of its
/// elements follow from pixel (i, j) of the picture and depth t: orthographic constant + i by_column + j by_row + t
/// by_depth, perspective constant + t (i by_column + j by_row + by_depth). In float64: rounded once they are relative
/// to a row of a tile.
struct VolumeLookup {
    const LightVolume* volume = nullptr; ///< null: everything is reached
    Vec3 constant{0.0}, by_column{0.0}, by_row{0.0}, by_depth{0.0};
};

/// light/surface_lines in the sheets' format: what is followed through grids of rho in mode isosurface.
template <class T>
struct SurfaceLight {
    struct Surface {
        T value;      ///< in the sheets' unit
        T absorption; ///< -log2(1 - opacity)
    };
    struct Line {
        T step[3]; ///< a slice distance along it, in elements
    };
    struct Kept {
        T normal[3], distance; ///< dot(normal, place) + distance >= 0
    };
    VolumeLookup place; ///< where pixels are in the grid
    struct Group {
        const LightVolume* rho;
        std::vector<Surface> surfaces;
        std::vector<Kept> kept;
    };
    std::vector<Group> groups; ///< empty: volumes hold the light itself
    std::vector<Line> to_lights, around;
    T around_steps = T(0);
};

/// What shade_slab reads. Lengths of gradients are in reference lengths.
template <class T>
struct Shading {
    Mode mode = Mode::composite;
    bool perspective = false;
    bool preintegration = false;
    bool second_order = false;
    bool empty_test = false;
    bool open_front = false; ///< isosurface: nothing crosses before slice 0
    bool gradient = false;   ///< for light, or for opacity
    bool lit = false;
    bool cuts = false; ///< clip, depth limit or the cell of a part take points of slices away
    /// Rows go through the effects one after the other, and not only where points are taken away: of what follows,
    /// anything is on, or preintegration of second order; or groups end apart, or colours are those of others.
    bool by_effects = false;
    bool analytic_gradient = false;
    bool gradient_opacity = false;
    bool cut_faces = false;
    bool depth_cue = false;
    bool shadows = false;
    bool occlusion = false;
    bool specular = false;
    bool two_sided = false;
    bool gray = false;    ///< all lights are
    bool correct = false; ///< a slice is not one reference length thick everywhere

    /// Mode isosurface: more than one surface, or a translucent one.
    bool several_surfaces = false;
    std::vector<GroupShading<T>> groups; ///< as groups_drawn: at least one
    std::size_t shown = 0;               ///< the first of them that is classified
    bool several_shown = false;          ///< more than one is

    T exponent = T(1); ///< slice spacing over reference length
    /// Pixels end at this opacity; isosurfaces that are all opaque: anything between 0 and 1.
    T stop = T(1);
    /// The picture's scalars in world units: xray: world value times world length that 1 in a sheet adds; else world
    /// value that 1 in a sheet stands for.
    T scalar_step = T(1);
    T coverage_step = T(1); ///< slice spacing, world units

    std::vector<ShadingLight<T>> lights;
    T ambient = T(1);
    T shininess = T(1);
    /// Components of the gradient are differences of rho times these; in perspective that across is divided by the
    /// depth. In float64: a slab's own scale is put in before they are rounded.
    double gradient_across = 0.0, gradient_along = 0.0;
    T gradient_doubt = T(1); ///< error of a slab's scaled gradient over that of rho

    std::vector<KeptHalfSpace> kept;     ///< all of them; none without a clip
    std::vector<VolumeLookup> shadow_of; ///< a light
    VolumeLookup openness;               ///< what ambient occlusion leaves open of a point's surroundings
    SurfaceLight<T> surface_light;       ///< in place of both, in mode isosurface
    T occlusion_strength = T(0);
    ShadingInputs inputs; ///< what effects read once a slab or row

    double face_length = 1.0;                      ///< ShadingInputs has it
    double first_depth = 0.0, slice_spacing = 1.0; ///< world units
    double nearest_depth = 0.0;                    ///< least depth that an interval reports
    /// Perspective: slope of the ray of pixel (i, j) is ((i - axis_x) pixel, (axis_y - j) pixel).
    double axis_x = 0.0, axis_y = 0.0, pixel = 0.0;
};

/// volumes: where the plan has shadows or ambient occlusion; not owned.
template <class T>
Shading<T> make_shading(const Scene& scene, const Camera& camera, const Frame& frame, const DrawPlan& plan,
                        const LightVolumes* volumes = nullptr);

extern template Shading<float> make_shading<float>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                                   const LightVolumes*);
extern template Shading<double> make_shading<double>(const Scene&, const Camera&, const Frame&, const DrawPlan&,
                                                     const LightVolumes*);

} // namespace sheetsplat::backend_cpu
