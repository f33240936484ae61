#include "reference/reference.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "base/memory.hpp"
#include "reference/classify.hpp"
#include "reference/clip.hpp"
#include "reference/composite.hpp"
#include "reference/counted.hpp"
#include "reference/screen.hpp"
#include "reference/shade.hpp"
#include "reference/slices.hpp"
#include "reference/sums.hpp"
#include "reference/surroundings.hpp"
#include "scene/mode_rules.hpp"
#include "sheetsplat/error.hpp"

namespace sheetsplat::reference {

namespace {

constexpr std::size_t sheets_in_window = 4;

void check_size(Size size) {
    if (size.width < 1 || size.height < 1) {
        throw InvalidInput(Complaint{"the picture cannot be drawn",
                                     std::to_string(size.width) + " x " + std::to_string(size.height) + " pixels",
                                     "at least 1 x 1", "correct " + option_ref("size"), "size"});
    }
}

bool has_analytic_gradients(const Scene& scene) {
    return scene.gradient == Gradient::analytic && calls_for_gradients(scene);
}

// Shadows are of lights.
bool needs_surroundings(const Scene& scene) {
    return (scene.shadows && !scene.lights.empty()) || scene.ambient_occlusion.has_value();
}

Sheet::Wanted wanted_of(const Scene& scene, const Request& request) {
    return {request.coverage, is_scalar(scene.mode), has_analytic_gradients(scene)};
}

void check_memory(Size size, const Scene& scene, const Request& request, std::size_t pictures) {
    // One product, which cannot overflow as a sum of two might; the border is neglected.
    const std::uint64_t pixels =
        static_cast<std::uint64_t>(size.width + 2LL) * static_cast<std::uint64_t>(size.height + 2LL);
    const bool scalar = is_scalar(scene.mode);
    const Sheet::Wanted wanted = wanted_of(scene, request);
    const std::uint64_t a_sheet = sizeof(double) + 1 + (wanted.weights ? sizeof(double) : 0) + (wanted.counts ? 1 : 0) +
                                  (wanted.gradients ? sizeof(Vec3) : 0);
    const std::uint64_t a_picture =
        ((scalar ? 1U : 4U) + (request.coverage ? 1U : 0U) + (request.depth ? 1U : 0U)) * sizeof(double);
    const std::uint64_t scratch = 3 * sizeof(double) + 1 + 2 * (wanted.gradients ? sizeof(Vec3) : 0);
    const std::string what = "the reference's sheets and picture";
    const std::size_t sheets = sheets_in_window * groups_drawn(scene).size();
    require_memory(checked_product(pixels, sheets * a_sheet + scratch + pictures * a_picture, what), what,
                   "make the picture smaller");
}

bool opaque_at_base(const TransferFunction& function, const std::vector<Nudge>& nudges) {
    const double range = function.v_max() - function.v_min();
    for (const Nudge& nudge : nudges) {
        if (look_up(function, nudge.rho * range).opacity > 0.0) {
            return true;
        }
    }
    return false;
}

ZeroKernels zero_kernels(const CountedScene& counted, const Group& group, std::size_t number, const Request& request,
                         const std::vector<Nudge>& nudges) {
    const Scene& scene = counted.scene();
    const Field& field = *scene.fields[number];
    if (is_label(group)) {
        // Kernels are those of the label's own samples.
        return ZeroKernels::left_out;
    }
    if (group.use.role == GroupRole::colors) {
        return ZeroKernels::drawn;
    }
    // Which points count matters less to an x-ray: those that do not could only add bases.
    const bool adds_base =
        std::any_of(scene.fields.begin(), scene.fields.end(), [](const auto& any) { return any->base() != 0.0; });
    const bool counts_matter = is_scalar(scene.mode) && (counts_weighted_slices(scene.mode) || adds_base);
    const bool weights_matter = request.coverage || counts_matter || field.normalization() == Normalization::threshold;
    // Of an interval of which an end is cut off, or whose cubic is not 0 between two ends that are, it matters whether
    // the ends are empty.
    const bool cut = !scene.clip.empty() || !counted.end_of_field(number).empty() || scene.depth_limit;
    const bool intervals = scene.preintegration && (scene.second_order || cut);
    const bool reach_matters =
        is_composited(scene.mode) && (intervals || opaque_at_base(*group.transfer_function, nudges));
    return weights_matter || reach_matters ? ZeroKernels::drawn : ZeroKernels::left_out;
}

/// The fields of each group.
using GroupedSums = std::vector<std::vector<std::unique_ptr<FieldSums>>>;

/// The last four sheets of each group, in the order of their slices.
class RollingSheets {
  public:
    RollingSheets(const Screen& screen, const Slices& slices, const GroupedSums& groups,
                  std::vector<GroupRange> label_sets, const Sheet::Wanted& wanted)
        : slices_(slices), groups_(groups), label_sets_(std::move(label_sets)), next_(slices.first - 2),
          sheets_(sheets_in_window * groups.size(), Sheet(screen, wanted)), sums_(sheets_.front()) {}

    /// The window around slice n; asked for n from the slice before the first on, one after the other.
    [[nodiscard]] SheetWindow around(std::int64_t n) {
        while (next_ <= n + 2) {
            make(next_++);
        }
        SheetWindow window{n, {}};
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            window.groups.push_back({&at(n - 1, group), &at(n, group), &at(n + 1, group), &at(n + 2, group)});
        }
        return window;
    }

  private:
    Sheet& at(std::int64_t n, std::size_t group) {
        const std::size_t place = static_cast<std::size_t>(n - slices_.first + 2) % sheets_in_window;
        return sheets_[group * sheets_in_window + place];
    }

    void make(std::int64_t n) {
        for (std::size_t group = 0; group < groups_.size(); ++group) {
            Sheet& sheet = at(n, group);
            sheet.clear();
            if (slices_.exists(n)) {
                for (const auto& field : groups_[group]) {
                    field->add_next(sheet, sums_);
                }
            }
        }
        for (const GroupRange& set : label_sets_) {
            std::vector<Sheet*> sheets;
            for (std::size_t group = set.first; group < set.last; ++group) {
                sheets.push_back(&at(n, group));
            }
            compare_labels(sheets);
        }
    }

    const Slices& slices_;
    const GroupedSums& groups_;
    std::vector<GroupRange> label_sets_;
    std::int64_t next_;
    std::vector<Sheet> sheets_;
    SheetSums sums_;
};

/// Pictures of the same sheets, one for each nudge.
std::vector<Picture> draw(const CountedScene& counted, const Camera& camera, Size size, const Request& request,
                          double radius_factor, const std::vector<Nudge>& nudges) {
    const Scene& scene = counted.scene();
    check_size(size);
    check_memory(size, scene, request, nudges.size());
    if (scene.depth_limit) {
        scene.depth_limit->require_for(size, camera);
    }

    const Screen screen(camera, size);
    const Slices slices = find_slices(scene, camera, screen, radius_factor);
    const Shader shader(counted, camera);
    const Clipping clipping(scene, camera);
    const Cell cell(scene, camera);
    std::optional<Surroundings> surroundings;
    if (slices.count > 0 && needs_surroundings(scene)) {
        surroundings.emplace(counted, camera, screen, clipping, radius_factor);
    }

    GroupedSums groups;
    std::size_t kernels_drawn = 0;
    for (const Group& group : slices.count > 0 ? groups_drawn(scene) : std::vector<Group>{}) {
        groups.emplace_back();
        for (std::size_t number = group.first; number < group.last; ++number) {
            groups.back().push_back(std::make_unique<FieldSums>(*scene.fields[number], counted.end_of_field(number),
                                                                scene, camera, screen, slices, radius_factor,
                                                                zero_kernels(counted, group, number, request, nudges)));
            kernels_drawn += groups.back().back()->drawn();
        }
    }
    std::vector<Compositor> compositors;
    for (const Nudge& nudge : nudges) {
        compositors.emplace_back(counted, camera, screen, slices, shader, clipping, cell,
                                 surroundings ? &*surroundings : nullptr, request, nudge);
    }

    const auto report = [&](std::int64_t intervals) {
        const double done = static_cast<double>(intervals) / static_cast<double>(slices.count + 1);
        if (request.progress && !request.progress(done)) {
            throw Cancelled();
        }
    };
    if (slices.count > 0) {
        RollingSheets sheets(screen, slices, groups, label_sets(groups_drawn(scene)), wanted_of(scene, request));
        for (std::int64_t n = slices.first - 1; n <= slices.last(); ++n) {
            const SheetWindow window = sheets.around(n);
            for (Compositor& compositor : compositors) {
                compositor.add(window, [&] { report(n - slices.first + 1); });
            }
            report(n - slices.first + 2);
        }
    }

    std::vector<Picture> pictures;
    for (Compositor& compositor : compositors) {
        pictures.push_back(compositor.finish());
        pictures.back().kernels_drawn = kernels_drawn;
    }
    return pictures;
}

/// Marks the pixels in which `moved` is not what `still` is.
void mark_changes(const Picture& still, const Picture& moved, double slice_distance,
                  std::vector<unsigned char>& marks) {
    constexpr double visible = 1e-3;
    for (std::size_t at = 0; at < still.rgba.size(); ++at) {
        if (!(std::abs(moved.rgba[at] - still.rgba[at]) <= visible)) {
            marks[at / 4] = 1;
        }
    }
    for (std::size_t at = 0; at < still.depth.size(); ++at) {
        const bool same = moved.depth[at] == still.depth[at]; // also where both are infinite
        if (!same && !(std::abs(moved.depth[at] - still.depth[at]) <= 0.5 * slice_distance)) {
            marks[at] = 1;
        }
    }
}

} // namespace

Picture render(const Scene& scene, const Camera& camera, Size size, const Request& request) {
    scene.validate();
    const CountedScene counted(scene);
    return std::move(
        draw(counted, camera, size, request, 1.0 + request.nudge_radius, {{request.nudge_rho, request.nudge_stop}})
            .front());
}

std::vector<unsigned char> ambiguous_pixels(const Scene& scene, const Camera& camera, Size size,
                                            const Request& request) {
    constexpr double little = 1e-5;
    scene.validate();
    check_size(size);
    check_memory(size, scene, request, 5);
    std::vector<unsigned char> marks(static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height), 0);
    if (is_scalar(scene.mode)) {
        return marks;
    }
    const CountedScene counted(scene);
    Request quiet = request;
    quiet.coverage = false;
    double done_before = 0.0;
    if (request.progress) {
        quiet.progress = [&](double done) { return request.progress((done_before + done) / 3.0); };
    }
    const Nudge still{request.nudge_rho, request.nudge_stop};
    const std::vector<Picture> same_radius = draw(counted, camera, size, quiet, 1.0 + request.nudge_radius,
                                                  {still,
                                                   {still.rho + little, still.stop},
                                                   {still.rho - little, still.stop},
                                                   {still.rho, still.stop + little},
                                                   {still.rho, still.stop - little}});
    for (const Picture& moved : same_radius) {
        mark_changes(same_radius.front(), moved, scene.slice_distance(), marks);
    }
    for (const double sign : {-1.0, 1.0}) {
        done_before += 1.0;
        const Picture moved =
            std::move(draw(counted, camera, size, quiet, 1.0 + request.nudge_radius + sign * little, {still}).front());
        mark_changes(same_radius.front(), moved, scene.slice_distance(), marks);
    }
    return marks;
}

} // namespace sheetsplat::reference
