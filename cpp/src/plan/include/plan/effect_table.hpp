// The one list of effects: which backends have each, whether it can be forced or what decides it, and what it means.
// Forcing, refusing, listing and the documentation (python/docs/effects.md) follow from this table.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sheetsplat {

enum class EffectId : std::uint8_t {
    classification,
    isosurface,
    normalization,
    several_fields,
    own_transfer_functions,
    separate_normalization,
    scattered_kernels,
    empty_test,
    empty_intervals,
    weight,
    ewa_filter,
    slab_sampling,
    perspective,
    general_sections,
    clip,
    gradient,
    analytic_gradient,
    fine_gradient,
    gradient_opacity,
    ambient_only,
    specular,
    two_sided,
    eye_lights,
    world_lights,
    shadows,
    ambient_occlusion,
    depth_cue,
    opacity_correction,
    preintegration,
    second_order,
    opacity_stop,
    elimination,
    opacity_buffer,
    culling,
    tagging,
    points,
    precise_sections,
    resident_sections,
    paper_slicing,
    compensation,
    sums,
    float64,
    float16,
    background,
    coverage,
    depth,
};

/// What a backend does with an effect.
enum class Control : std::uint8_t {
    absent,   ///< it has no such effect, and its plans do not list it
    decided,  ///< its plans list it, but RendererOptions::effects cannot force it
    forcible, ///< its plans list it, and RendererOptions::effects can force it
};

struct EffectEntry {
    EffectId id;
    const char* name;
    Control gl, cpu, reference;
    const char* decided_by; ///< null where some backend can force it
    const char* meaning;    ///< of being on
};

namespace effects_detail {
constexpr Control no = Control::absent, is = Control::decided, can = Control::forcible;
}

// clang-format off
constexpr std::array<EffectEntry, 46> effect_table = [] {
    using namespace effects_detail;
    using Id = EffectId;
    return std::array<EffectEntry, 46>{{
    // id                          name                    gl   cpu  reference
    {Id::classification,         "classification",         is,  is,  is, "the scene's mode", "values become colours (modes composite and isosurface)"},
    {Id::isosurface,             "isosurface",             is,  is,  is, "the scene's mode", "crossings of iso values are shown"},
    {Id::normalization,          "normalization",          is,  is,  is, "the fields' normalization", "sums of values are divided by a constant or by sums of weights"},
    {Id::several_fields,         "several_fields",         is,  is,  is, "the scene's fields", "the scalars of several fields add up"},
    {Id::own_transfer_functions, "own_transfer_functions", is,  is,  is, "the scene's transfer functions", "groups of fields are classified by transfer functions of their own"},
    {Id::separate_normalization, "separate_normalization", is,  is,  is, "the fields' normalization", "fields are divided by their own weight sums before they are added"},
    {Id::scattered_kernels,      "scattered_kernels",      is,  is,  is, "the scene's fields", "kernels are ellipsoids that are sliced one by one"},
    {Id::empty_test,             "empty_test",             can, can, is,  nullptr, "points that no kernel reaches are told from points where the sum is 0"},
    {Id::empty_intervals,        "empty_intervals",        is,  is,  no, "the scene's clip and preintegration", "intervals that no kernel reaches are told from intervals whose ends are 0"},
    {Id::weight,                 "weight",                 can, can, is,  nullptr, "sums of weights are kept beside sums of values"},
    {Id::ewa_filter,             "ewa_filter",             is,  is,  is, "the scene's filter", "small kernels are widened and keep their mass"},
    {Id::slab_sampling,          "slab_sampling",          is,  is,  is, "the scene's sampling", "slices hold means over their slabs"},
    {Id::perspective,            "perspective",            is,  is,  is, "the camera", "the camera is perspective"},
    {Id::general_sections,       "general_sections",       can, can, is,  nullptr, "sections of a lattice's kernel move or scale from slab to slab"},
    {Id::clip,                   "clip",                   can, can, is,  nullptr, "points outside the scene's clip are transparent"},
    {Id::gradient,               "gradient",               can, can, is,  nullptr, "gradients are made, for light or for gradient_opacity"},
    {Id::analytic_gradient,      "analytic_gradient",      can, can, is,  nullptr, "gradients are sums of the kernels' own derivatives"},
    {Id::fine_gradient,          "fine_gradient",          can, no,  no, nullptr, "differences of neighbouring samples are splatted, since differences of sums would lose their digits"},
    {Id::gradient_opacity,       "gradient_opacity",       can, can, is,  nullptr, "opacity is multiplied by min(1, gradient / gradient_opacity)"},
    {Id::ambient_only,           "ambient_only",           is,  is,  is, "the scene's lights and material", "only ambient light is reflected, so no normals are made"},
    {Id::specular,               "specular",               can, can, is,  nullptr, "highlights are added"},
    {Id::two_sided,              "two_sided",              can, can, is,  nullptr, "normals turn towards each light"},
    {Id::eye_lights,             "eye_lights",             is,  is,  is, "the scene's lights", "some lights move with the camera"},
    {Id::world_lights,           "world_lights",           is,  is,  is, "the scene's lights", "some lights are fixed in the world"},
    {Id::shadows,                "shadows",                can, can, is,  nullptr, "matter between a point and a light dims the light"},
    {Id::ambient_occlusion,      "ambient_occlusion",      can, can, is,  nullptr, "matter around a point dims ambient light"},
    {Id::depth_cue,              "depth_cue",              can, can, is,  nullptr, "colours fade with depth"},
    {Id::opacity_correction,     "opacity_correction",     can, can, is,  nullptr, "opacity is converted from the reference length to the slice spacing"},
    {Id::preintegration,         "preintegration",         is,  is,  is, "the scene's preintegration", "intervals between slices are classified instead of slices"},
    {Id::second_order,           "second_order",           can, can, is,  nullptr, "pre-integration takes the curvature inside intervals into account"},
    {Id::opacity_stop,           "opacity_stop",           can, can, is,  nullptr, "pixels end when their opacity reaches opacity_stop"},
    {Id::elimination,            "elimination",            can, is,  is, nullptr, "pixels that are opaque already are skipped"},
    {Id::opacity_buffer,         "opacity_buffer",         can, is,  is, nullptr, "kernels behind opaque blocks of pixels are skipped, by an opacity buffer that is read back"},
    {Id::culling,                "culling",                can, can, is, nullptr, "kernels that cannot be seen are skipped"},
    {Id::tagging,                "tagging",                is,  is,  is, "the renderer's tagging", "pixels that no kernel touches are skipped"},
    {Id::points,                 "points",                 is,  no,  no, "the camera and the kernels' sizes", "kernels are drawn as point sprites instead of quads"},
    {Id::precise_sections,       "precise_sections",       can, no,  no, nullptr, "slender or tiny ellipsoids are placed in float64"},
    {Id::resident_sections,      "resident_sections",      can, no,  no, nullptr, "ellipsoids are sliced by one pass on the device, where the sections stay"},
    {Id::paper_slicing,          "paper_slicing",          can, no,  no, nullptr, "ellipsoids are sliced and drawn step by step as in the 2006 paper, for comparison"},
    {Id::compensation,           "compensation",           can, no,  no, nullptr, "composites of very many slices carry their rounding errors along"},
    {Id::sums,                   "sums",                   is,  is,  is, "the renderer's precision", "kernels are summed (always), in the precision that the reason names"},
    {Id::float64,                "float64",                no,  is,  no, "the renderer's precision", "sums and pictures are made in float64"},
    {Id::float16,                "float16",                is,  no,  no, "the renderer's precision", "sheets have 16 bits"},
    {Id::background,             "background",             is,  is,  is, "the scene's background", "a background is put behind the picture"},
    {Id::coverage,               "coverage",               is,  is,  is, "outputs=", "the coverage picture was asked for"},
    {Id::depth,                  "depth",                  is,  is,  is, "outputs=", "the depth picture was asked for"},
    }};
}();
// clang-format on

constexpr const EffectEntry& entry_of(EffectId id) { return effect_table[static_cast<std::size_t>(id)]; }
constexpr const char* name_of(EffectId id) { return entry_of(id).name; }

} // namespace sheetsplat
