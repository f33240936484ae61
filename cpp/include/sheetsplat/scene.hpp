// A scene: fields, how they are classified, lit and composited. Source: conventions, sections 3 to 7.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sheetsplat/camera.hpp"
#include "sheetsplat/field.hpp"
#include "sheetsplat/mode_table.hpp"
#include "sheetsplat/transfer_function.hpp"
#include "sheetsplat/types.hpp"

namespace sheetsplat {

enum class Sampling {
    point, ///< a slice holds the field at its depth ([NM06])
    slab,  ///< a slice holds the mean over its slab along the pixel's ray ([NM05])
};

enum class LightSpace { eye, world };

/// Opacity at which a pixel is finished, unless given (conventions, section 6).
constexpr double default_opacity_stop = 0.98;

/// What is done to kernels before they are sliced.
enum class Filter {
    none,
    ewa, ///< widened by a pixel across and a slice distance along the view, at the same mass (conventions section
         ///< 10)
};

/// Where gradients come from (conventions, sections 5 and 10).
enum class Gradient {
    sheets,   ///< central differences of the sheets' sums
    analytic, ///< sums of the kernels' own derivatives
};

/// What is kept of the picture's points: those in all half spaces and in the box (section 10). World coordinates.
struct Clip {
    /// Points x with dot(normal, x) >= offset are kept. `normal` need not have unit length.
    struct Plane {
        Vec3 normal{0.0, 0.0, 1.0};
        double offset = 0.0;
        /// Of a face of a polyhedron that stands for a sphere: its middle. Cut faces are round there.
        std::optional<Vec3> center{};
    };
    std::vector<Plane> planes{};
    std::optional<Parallelepiped> box{};

    /// True where nothing is cut off.
    [[nodiscard]] bool empty() const { return planes.empty() && !box; }
    /// The planes, and the box as six of them.
    [[nodiscard]] std::vector<Plane> half_spaces() const;
};

/// Depths of a surface that was drawn elsewhere with the same camera: of each pixel, the points of slices at this depth
/// or behind it are cut off (section 10).
class DepthLimit {
  public:
    /// depths: h * w, row 0 at the top, world units from the eye along the view direction; infinite where nothing is
    /// cut off. Throws InvalidInput for another number of depths, NaN and -infinity.
    DepthLimit(Size size, std::vector<double> depths);

    [[nodiscard]] Size size() const { return size_; }
    [[nodiscard]] double at(int column, int row) const {
        return (*depths_)[static_cast<std::size_t>(row) * static_cast<std::size_t>(size_.width) +
                          static_cast<std::size_t>(column)];
    }
    /// The smallest and the largest depth.
    [[nodiscard]] double nearest() const { return nearest_; }
    [[nodiscard]] double farthest() const { return farthest_; }

    /// Throws InvalidInput where a picture has another size, or a depth lies behind the eye of a perspective camera.
    void require_for(Size picture, const Camera& camera) const;

  private:
    Size size_;
    std::shared_ptr<const std::vector<double>> depths_;
    double nearest_, farthest_;
};

struct LightVolumes;

/// What a picture needs to know where the fields of its scene are a part of larger ones: a brick, with what its
/// neighbours' kernels add to it (conventions, section 11). Belongs to one camera and size.
struct Part {
    /// The points that are drawn, lower <= x < upper (of a parallelepiped: to_box x); infinite where there is no
    /// neighbour. Intervals and crossings belong to the point of the slice before them; what lies before the first
    /// slice to that of the first one.
    Parallelepiped cell{};
    /// World-aligned box of all kernel centres of the whole, by which slices are anchored.
    Box centres{};
    /// The nearest and the farthest depth that kernels of the whole reach.
    std::array<double, 2> depths{};
    /// Opacity of each pixel in front of the part, h * w, row 0 at the top: pixels stop, and reach one half, with it.
    /// The picture's colours are what the part adds, its opacities those of both. Null: none.
    std::shared_ptr<const std::vector<float>> in_front{};
    /// World-aligned box of all supports of the whole: Renderer::plan_light needs it.
    Box supports{};
    /// Where the whole ends (RegularField::domain), if anywhere.
    std::optional<Parallelepiped> domain{};
    /// Kernels reach every point of the domain.
    bool filled = false;
    /// What shadows and ambient occlusion of the whole leave of light: pictures with them need it.
    std::shared_ptr<const LightVolumes> light{};

    /// True where some points are not drawn.
    [[nodiscard]] bool cuts() const;
};

/// Shaded colours fade to `color` between two depths: by `strength` from `end` on (section 10).
struct DepthCue {
    double start = 0.0; ///< depth t, world units
    double end = 1.0;   ///< above start
    Vec3 color{0.0, 0.0, 0.0};
    double strength = 1.0; ///< 0 to 1
};

/// Ambient light fades where its surroundings are dense (section 10).
struct AmbientOcclusion {
    double radius = 1.0;   ///< how far away what occludes may be, world units
    double strength = 1.0; ///< 0 to 1
};

/// A directional light. `direction` points towards the light; it need not have unit length.
struct Light {
    Vec3 direction{0.0, 0.0, 1.0};
    Vec3 color{1.0, 1.0, 1.0};
    LightSpace space = LightSpace::eye;
};

/// Phong coefficients.
struct Material {
    double ambient = 0.1;
    double diffuse = 0.9;
    double specular = 0.0;
    double shininess = 32.0;
    bool two_sided = false;
};

/// A value of mode isosurface, and how opaque its surface is.
struct IsoValue {
    IsoValue(double value_of_surface, double opacity_of_surface = 1.0)
        : value(value_of_surface), opacity(opacity_of_surface) {}
    double value;
    double opacity; ///< 0 to 1

    friend bool operator==(const IsoValue& a, const IsoValue& b) {
        return a.value == b.value && a.opacity == b.opacity;
    }
};

/// What the scalar of a group of fields is for (section 4).
enum class GroupRole {
    shown,    ///< its transfer function classifies it
    colors,   ///< its transfer function's colours take the place of those of the group before it where it is not empty;
              ///< those of several in a row add up
    label,    ///< its field is 1 at the samples of a label: shown where it is the largest of its set of labels
    compared, ///< the same of a label that is not shown
};
struct GroupUse {
    GroupRole role = GroupRole::shown;
    std::size_t set = 0; ///< of labels: neighbouring groups of one number are compared with each other

    friend bool operator==(const GroupUse& a, const GroupUse& b) { return a.role == b.role && a.set == b.set; }
};

/// Fields of a scene whose scalars add up before the transfer function classifies the sum (section 4).
struct Group {
    std::size_t first; ///< Scene::fields[first] ... Scene::fields[last - 1]
    std::size_t last;
    const TransferFunction* transfer_function; ///< the scene's: valid while that is
    GroupUse use{};
};

/// What a renderer makes of the bases and the ends of fields (conventions, section 2) before it draws them as sums of
/// kernels: fields hold their mirrored samples and end nowhere, `clip` ends them, and transfer functions are counted
/// from the bases of each group's fields, which add up; iso values as iso_values_of() says.
struct Counted {
    std::vector<double> bases{}; ///< of each group, what its transfer function and iso values are counted from
    /// The picture says how many slices of each pixel count: an x-ray is drawn as the average where bases are not 0 or
    /// samples are missing.
    bool counts = false;
    Clip clip{}; ///< the scene's own, without the ends of fields
    /// Kernels reach every point that the ends of fields keep: no point there is empty.
    bool filled = false;
    /// Where the fields of each group end, if they do not all end in one place; then the scene's clip does not end
    /// them, and scalar modes add the base of each group where its fields are.
    std::vector<std::optional<Parallelepiped>> ends{};
    /// Why mirrored samples and ends are drawn, or why they are not.
    bool mirrored = false;
    std::string reason{};
};

/// Which modes use an option of a scene (mode_table.hpp).
enum class Applies {
    always,    ///< all, or others ignore it
    colors,    ///< others refuse it
    opacities, ///< modes that composite slices by their opacities; others refuse it
};

// X(type, name, default, which modes use it). The options of a scene, each once: members, equality, bindings and the
// rules of modes follow. Their meaning: conventions, sections 3 to 10; units: world.
// clang-format off
#define SHEETSPLAT_SCENE_OPTIONS(X) \
    X(std::optional<double>, slice_spacing, {}, always)  /* distance; of the fields where it is not given */ \
    X(Sampling, sampling, Sampling::point, always) \
    X(std::optional<double>, reference_length, {}, always)  /* of opacities; of the fields where it is not given */ \
    X(Mode, mode, Mode::composite, always) \
    X(std::vector<IsoValue>, iso_values, {}, always)  /* mode isosurface needs at least one; others ignore them */ \
    X(std::vector<Light>, lights, {}, always) \
    X(Material, material, {}, always) \
    X(double, opacity_stop, default_opacity_stop, always)  /* 1 = never */ \
    X(bool, preintegration, false, opacities)  /* [EKE01] */ \
    X(bool, second_order, false, always)  /* of pre-integration: Romberg's step over the interval and its halves */ \
    X(Filter, filter, Filter::none, always) \
    X(Gradient, gradient, Gradient::sheets, always) \
    X(Clip, clip, {}, always) \
    X(std::optional<double>, gradient_opacity, {}, opacities)  /* g1: opacity times min(1, |grad rho| / g1) */ \
    X(bool, cut_faces, false, always)  /* faces of clip and fields' ends have the normal of the cut */ \
    X(std::optional<DepthCue>, depth_cue, {}, colors) \
    X(bool, shadows, false, colors)  /* of all lights */ \
    X(std::optional<AmbientOcclusion>, ambient_occlusion, {}, colors) \
    X(std::optional<Vec3>, background, {}, always)
// clang-format on

/// Everything about a picture but the camera and its size; a depth limit belongs to one camera and size.
struct Scene {
    /// A group after the first one: its transfer function, and where in `fields` it begins. It ends where the next
    /// group begins.
    struct LaterGroup {
        std::size_t first_field;
        TransferFunction transfer_function;
        GroupUse use{};
    };

    std::vector<std::shared_ptr<const Field>> fields; ///< of all groups, one group after the other
    TransferFunction transfer_function;               ///< of the first group
    GroupUse use{};                                   ///< of the first group
    std::vector<LaterGroup> later_groups{};
#define SHEETSPLAT_SCENE_MEMBER(type, name, value, applies) type name = value;
    SHEETSPLAT_SCENE_OPTIONS(SHEETSPLAT_SCENE_MEMBER)
#undef SHEETSPLAT_SCENE_MEMBER
    std::optional<DepthLimit>
        depth_limit{};                ///< of pictures of its size, with the camera that the surface was drawn with
    std::optional<Counted> counted{}; ///< set by renderers alone
    std::optional<Part> part{}; ///< where the fields are a part of larger ones: the picture has no background then

    /// All groups, the first one included. In scalar modes the scalars of all groups add up.
    [[nodiscard]] std::vector<Group> groups() const;
    /// The default slice distance of all fields: the smallest of theirs; 1 where no field has a kernel.
    [[nodiscard]] double default_slice_spacing() const;
    [[nodiscard]] double slice_distance() const { return slice_spacing.value_or(default_slice_spacing()); }
    [[nodiscard]] double reference_distance() const { return reference_length.value_or(default_slice_spacing()); }
    /// World-aligned box of all kernel centres of all fields; of a part, those of the whole.
    [[nodiscard]] Box centres_world() const;
    /// Throws InvalidInput where a number or a combination has no meaning.
    void validate() const;
};

/// Calls visit(name, which modes use it, member) for every option.
template <class AnyScene, class Visit>
void for_each_option(AnyScene& scene, const Visit& visit) {
#define SHEETSPLAT_VISIT_OPTION(type, name, value, applies) visit(#name, Applies::applies, scene.name);
    SHEETSPLAT_SCENE_OPTIONS(SHEETSPLAT_VISIT_OPTION)
#undef SHEETSPLAT_VISIT_OPTION
}

} // namespace sheetsplat
