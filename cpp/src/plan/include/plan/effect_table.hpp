// The one list of effects: which backends have each, whether it can be forced or what decides it, and what it means.
// Forcing, refusing, listing and the documentation (python/docs/effects.md) follow from this table.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "sheetsplat/backend_table.hpp"

namespace sheetsplat {

/// What a backend does with an effect.
enum class Control : std::uint8_t {
    absent,   ///< it has no such effect, and its plans do not list it
    decided,  ///< its plans list it, but RendererOptions::effects cannot force it
    forcible, ///< its plans list it, and RendererOptions::effects can force it
};

// X(name, backends gl, cpu and reference in the order of backend_table, what decides it, its meaning). no, is, can:
// Control::absent, decided and forcible. What decides it: null where some backend can force it.
// clang-format off
#define SHEETSPLAT_EFFECTS(X) \
    X(classification,          is,  is,  is, "the scene's mode", "values become colours (modes composite and isosurface)") \
    X(isosurface,              is,  is,  is, "the scene's mode", "crossings of iso values are shown") \
    X(normalization,           is,  is,  is, "the fields' normalization", "sums of values are divided by a constant or by sums of weights") \
    X(several_fields,          is,  is,  is, "the scene's fields", "the scalars of several fields add up") \
    X(own_transfer_functions,  is,  is,  is, "the scene's transfer functions", "groups of fields are classified by transfer functions of their own") \
    X(labels,                  is,  is,  is, "the scene's labels", "weights of labels are compared, and each shows where its own is the largest") \
    X(other_colors,            is,  is,  is, "the scene's color_by", "colours come from other fields than opacities") \
    X(separate_normalization,  is,  is,  is, "the fields' normalization", "fields are divided by their own weight sums before they are added") \
    X(scattered_kernels,       is,  is,  is, "the scene's fields", "kernels are ellipsoids that are sliced one by one") \
    X(boundary,                is,  is,  is, "the fields' boundary and what shows there", "samples are mirrored where lattices end, and what lies beyond is cut off") \
    X(empty_test,              can, can, is, nullptr, "points that no kernel reaches are distinguished from points where the sum is 0") \
    X(empty_intervals,         is,  is,  no, "the scene's clip, the depth limit and preintegration", "intervals that no kernel reaches are distinguished from intervals whose ends are 0") \
    X(weight,                  can, can, is, nullptr, "sums of weights are kept beside sums of values") \
    X(ewa_filter,              is,  is,  is, "the scene's filter", "small kernels are widened and keep their mass") \
    X(slab_sampling,           is,  is,  is, "the scene's sampling", "slices hold means over their slabs") \
    X(perspective,             is,  is,  is, "the camera", "the camera is perspective") \
    X(general_sections,        can, can, is, nullptr, "sections of a lattice's kernel move or scale from slab to slab") \
    X(clip,                    can, can, is, nullptr, "points outside the scene's clip are transparent") \
    X(depth_limit,             can, can, is, nullptr, "points at or behind a surface that was drawn elsewhere are transparent") \
    X(gradient,                can, can, is, nullptr, "gradients are made, for light or for gradient_opacity") \
    X(analytic_gradient,       can, can, is, nullptr, "gradients are sums of the kernels' own derivatives") \
    X(fine_gradient,           can, no,  no, nullptr, "differences of neighbouring samples are splatted, since differences of sums would lose their digits") \
    X(gradient_opacity,        can, can, is, nullptr, "opacity is multiplied by min(1, gradient / gradient_opacity)") \
    X(cut_faces,               can, can, is, nullptr, "faces of cuts have the normal of the cut where the volume is opaque there") \
    X(ambient_only,            is,  is,  is, "the scene's lights and material", "only ambient light is reflected, so no normals are made") \
    X(specular,                can, can, is, nullptr, "highlights are added") \
    X(two_sided,               can, can, is, nullptr, "normals turn towards each light") \
    X(eye_lights,              is,  is,  is, "the scene's lights", "some lights move with the camera") \
    X(world_lights,            is,  is,  is, "the scene's lights", "some lights are fixed in the world") \
    X(shadows,                 can, can, is, nullptr, "matter between a point and a light dims the light") \
    X(ambient_occlusion,       can, can, is, nullptr, "matter around a point dims ambient light") \
    X(depth_cue,               can, can, is, nullptr, "colours fade with depth") \
    X(opacity_correction,      can, can, is, nullptr, "opacity is converted from the reference length to the slice spacing") \
    X(preintegration,          is,  is,  is, "the scene's preintegration", "intervals between slices are classified instead of slices") \
    X(second_order,            can, can, is, nullptr, "pre-integration takes the curvature inside intervals into account") \
    X(opacity_stop,            can, can, is, nullptr, "pixels end when their opacity reaches opacity_stop") \
    X(elimination,             can, is,  is, nullptr, "pixels that are opaque already are skipped") \
    X(opacity_buffer,          can, is,  is, nullptr, "kernels behind opaque blocks of pixels are skipped, by an opacity buffer that is read back") \
    X(culling,                 can, can, is, nullptr, "kernels that cannot be seen are skipped") \
    X(tagging,                 is,  is,  is, "the renderer's tagging", "pixels that no kernel touches are skipped") \
    X(points,                  is,  no,  no, "the camera and the kernels' sizes", "kernels are drawn as point sprites instead of quads") \
    X(precise_sections,        can, no,  no, nullptr, "slender or tiny ellipsoids are placed in float64") \
    X(resident_sections,       can, no,  no, nullptr, "ellipsoids are sliced by one pass on the device, where the sections stay") \
    X(computed_tiles,          is,  no,  no, "the renderer's path", "compute programs draw tiles whose sheets stay on the chip") \
    X(paper_slicing,           can, no,  no, nullptr, "ellipsoids are sliced and drawn step by step as in the 2006 paper, for comparison") \
    X(compensation,            can, no,  no, nullptr, "composites of very many slices carry their rounding errors along") \
    X(ray_extremes,            no,  can, no, nullptr, "rays look up rho where bounds of blocks allow a larger or smaller one, and no sheets are summed") \
    X(sums,                    is,  is,  is, "the renderer's precision", "kernels are summed (always), in the precision that the reason names") \
    X(float64,                 no,  is,  no, "the renderer's precision", "sums and pictures are made in float64") \
    X(float16,                 is,  no,  no, "the renderer's precision", "sheets have 16 bits") \
    X(background,              is,  is,  is, "the scene's background", "a background is put behind the picture") \
    X(coverage,                is,  is,  is, "outputs=", "the coverage picture was asked for") \
    X(depth,                   is,  is,  is, "outputs=", "the depth picture was asked for")
// clang-format on

enum class EffectId : std::uint8_t {
#define SHEETSPLAT_EFFECT_ID(name, ...) name,
    SHEETSPLAT_EFFECTS(SHEETSPLAT_EFFECT_ID)
#undef SHEETSPLAT_EFFECT_ID
};

struct EffectEntry {
    EffectId id;
    const char* name;
    std::array<Control, backend_table.size()> controls; ///< a backend each
    const char* decided_by;                             ///< null where some backend can force it
    const char* meaning;                                ///< of being on
};

#define SHEETSPLAT_EFFECT_ENTRY(name, gl, cpu, reference, ...)                                                         \
    EffectEntry{EffectId::name, #name, {gl, cpu, reference}, __VA_ARGS__},
constexpr std::array effect_table = [] {
    constexpr Control no = Control::absent, is = Control::decided, can = Control::forcible;
    return std::array{SHEETSPLAT_EFFECTS(SHEETSPLAT_EFFECT_ENTRY)};
}();
#undef SHEETSPLAT_EFFECT_ENTRY

constexpr const EffectEntry& entry_of(EffectId id) { return effect_table[static_cast<std::size_t>(id)]; }
constexpr Control control_of(const EffectEntry& entry, Backend backend) { return entry.controls[index_of(backend)]; }
constexpr const char* name_of(EffectId id) { return entry_of(id).name; }

} // namespace sheetsplat
