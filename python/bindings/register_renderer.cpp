// What Python sees of the renderer.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>

#include "convert.hpp"
#include "registrars.hpp"
#include "released.hpp"
#include "sheetsplat/light_probe.hpp"
#include "sheetsplat/renderer.hpp"

namespace py = pybind11;

namespace sheetsplat::bindings {
namespace {

const std::map<std::string, Backend> backends = [] {
    std::map<std::string, Backend> all{{to_string(Backend::automatic), Backend::automatic}};
    for (const BackendTraits& traits : backend_table) {
        all.emplace(traits.name, traits.backend);
    }
    return all;
}();
const std::map<std::string, Precision> precisions{{"auto", Precision::automatic},
                                                  {"uint8", Precision::uint8},
                                                  {"float16", Precision::float16},
                                                  {"float32", Precision::float32},
                                                  {"float64", Precision::float64}};
const std::map<std::string, Tagging> taggings{{"auto", Tagging::automatic},
                                              {"depth_bounds", Tagging::depth_bounds},
                                              {"depth_equal", Tagging::depth_equal},
                                              {"tiles", Tagging::tiles},
                                              {"off", Tagging::off}};
const std::map<std::string, Packing> packings{
    {"auto", Packing::automatic}, {"paper", Packing::paper}, {"wide", Packing::wide}};
const std::map<std::string, Path> paths{
    {"auto", Path::automatic}, {"raster", Path::raster}, {"compute", Path::compute}};

/// Between slices: signals and the caller's callback. Taking the GIL after every slice would make threads of Python
/// stutter, so that calls in quick succession are let through unseen.
class Watch {
  public:
    explicit Watch(py::object callback) : callback_(std::move(callback)) {}
    ~Watch() {
        const py::gil_scoped_acquire acquire;
        callback_ = py::object();
        raised_.reset();
    }
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    bool operator()(double share) {
        const auto now = std::chrono::steady_clock::now();
        if (seen_ && share < 1.0 && now - last_ < interval) {
            return true;
        }
        seen_ = true;
        last_ = now;
        if (Released::ending_elsewhere()) {
            return false;
        }
        const py::gil_scoped_acquire acquire;
        try {
            if (PyErr_CheckSignals() != 0) {
                throw py::error_already_set();
            }
            if (!callback_.is_none()) {
                const py::object answer = callback_(share);
                return !answer.is(py::bool_(false));
            }
        } catch (py::error_already_set& error) {
            raised_ = std::move(error);
            return false;
        }
        return true;
    }

    /// With the GIL held: raises what a signal handler or the callback raised.
    void rethrow() {
        if (raised_) {
            py::error_already_set error = std::move(*raised_);
            raised_.reset();
            throw error;
        }
    }

  private:
    static constexpr std::chrono::milliseconds interval{20};
    py::object callback_;
    std::optional<py::error_already_set> raised_;
    std::chrono::steady_clock::time_point last_;
    bool seen_ = false;
};

using Grid = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;
/// Columns of a table of LightSpot, in the order of its members.
constexpr std::size_t spot_columns = 15;

Numbers table_of(const std::vector<LightSpot>& spots) {
    Numbers rows({spots.size(), spot_columns});
    double* to = rows.mutable_data();
    for (const LightSpot& spot : spots) {
        for (const double value : {static_cast<double>(spot.number), static_cast<double>(spot.slice), spot.behind,
                                   static_cast<double>(spot.group), spot.color.x, spot.color.y, spot.color.z,
                                   spot.share, spot.chances[0], spot.chances[1], static_cast<double>(spot.part),
                                   spot.occlusion ? 1.0 : 0.0, spot.stands_for[0], spot.stands_for[1], spot.on_face}) {
            *to++ = value;
        }
    }
    return rows;
}

std::vector<LightSpot> spots_of(const Numbers& rows) {
    if (rows.ndim() != 2 || static_cast<std::size_t>(rows.shape(1)) != spot_columns) {
        throw std::invalid_argument("spots with another number of columns than light_spots has");
    }
    std::vector<LightSpot> spots(static_cast<std::size_t>(rows.shape(0)));
    const double* from = rows.data();
    for (LightSpot& spot : spots) {
        spot = {static_cast<std::size_t>(from[0]),
                static_cast<std::int64_t>(from[1]),
                from[2],
                static_cast<std::size_t>(from[3]),
                {from[4], from[5], from[6]},
                from[7],
                {from[8], from[9]},
                static_cast<std::size_t>(from[10]),
                from[11] != 0.0,
                {from[12], from[13]},
                from[14]};
        from += spot_columns;
    }
    return spots;
}

/// A renderer serves one thread at a time: others wait, without the GIL.
class LockedRenderer {
  public:
    explicit LockedRenderer(const RendererOptions& options) : renderer_(options) {}

    std::shared_ptr<RenderPlan> plan(const Scene& scene, const Camera& camera, std::array<int, 2> size, bool coverage,
                                     bool depth) {
        refuse_held();
        const Released release;
        const Hold hold(*this);
        return std::make_shared<RenderPlan>(renderer_.plan(scene, camera, {size[0], size[1]}, {coverage, depth}));
    }

    std::shared_ptr<Image> render(const Scene& scene, const Camera& camera, std::array<int, 2> size, bool coverage,
                                  bool depth, const py::object& progress) {
        return draw<Image>(progress, [&](const Progress& watch) {
            return renderer_.render(scene, camera, {size[0], size[1]}, {coverage, depth}, watch);
        });
    }

    std::unique_ptr<Stages> begin_stages(const Scene& scene, const Camera& camera, std::array<int, 2> size,
                                         bool coverage, bool depth, double first_seconds) {
        refuse_held();
        const Released release;
        const Hold hold(*this);
        return std::make_unique<Stages>(renderer_, scene, camera, Size{size[0], size[1]}, Outputs{coverage, depth},
                                        first_seconds);
    }

    std::shared_ptr<Image> next_stage(Stages& stages, const py::object& progress) {
        return draw<Image>(progress, [&](const Progress& watch) { return stages.next(watch); });
    }

    std::shared_ptr<ErrorEstimate> estimate_error(const Image& image, const Scene& scene, const Camera& camera,
                                                  const py::object& progress) {
        return draw<ErrorEstimate>(
            progress, [&](const Progress& watch) { return renderer_.estimate_error(image, scene, camera, watch); });
    }

    LightPlan plan_light(const Scene& part, const Camera& camera, std::array<int, 2> size) {
        refuse_held();
        const Released release;
        const Hold hold(*this);
        return renderer_.plan_light(part, camera, {size[0], size[1]});
    }

    py::list light_pieces(const Scene& part, const Camera& camera, std::array<int, 2> size, const LightPlan& light,
                          const py::object& progress) {
        const auto pieces = draw<std::vector<LightPiece>>(progress, [&](const Progress& watch) {
            return renderer_.light_pieces(part, camera, {size[0], size[1]}, light, watch);
        });
        py::list found;
        for (const LightPiece& piece : *pieces) {
            const auto& [u, v, w] = piece.first;
            const auto& [columns, rows, planes] = piece.counts;
            found.append(py::make_tuple(piece.grid, py::make_tuple(w, v, u),
                                        py::array_t<float>({planes, rows, columns}, piece.values.data())));
        }
        return found;
    }

    Numbers light_spots(const Scene& part, const Camera& camera, std::array<int, 2> size,
                        const std::vector<std::size_t>& numbers, const py::object& progress) {
        return table_of(*draw<std::vector<LightSpot>>(progress, [&](const Progress& watch) {
            return renderer_.light_spots(part, camera, {size[0], size[1]}, numbers, watch);
        }));
    }

    py::tuple light_lines(const Scene& part, const Camera& camera, std::array<int, 2> size, const Numbers& rows,
                          std::size_t number, const py::object& progress) {
        const std::vector<LightSpot> spots = spots_of(rows);
        const auto lines = draw<LightLines>(progress, [&](const Progress& watch) {
            return renderer_.light_lines(part, camera, {size[0], size[1]}, spots, number, watch);
        });
        const auto table = [&](const std::vector<double>& values) {
            return Numbers({spots.size(), spots.empty() ? 0 : values.size() / spots.size()}, values.data());
        };
        return py::make_tuple(lines->absorbed, lines->lights, table(lines->left), table(lines->shown));
    }

    std::shared_ptr<LightVolumes> light_volumes(const LightPlan& light, const std::vector<Grid>& values,
                                                const py::object& progress) {
        std::vector<LightVolume> grids;
        for (std::size_t number = 0; number < light.grids.size(); ++number) {
            grids.push_back(laid_out(light.grids[number], light.surfaces));
            std::vector<float>& to = grids.back().values;
            const Grid& from = values.at(number);
            if (static_cast<std::size_t>(from.size()) != to.size()) {
                throw std::invalid_argument("values of another size than the grid's");
            }
            std::copy(from.data(), from.data() + from.size(), to.begin());
        }
        return draw<LightVolumes>(
            progress, [&](const Progress& watch) { return renderer_.light_volumes(light, std::move(grids), watch); });
    }

  private:
    template <class Made, class Make>
    std::shared_ptr<Made> draw(const py::object& progress, Make&& make) {
        refuse_held();
        Watch watch(progress);
        try {
            const Released release;
            const Hold hold(*this);
            return std::make_shared<Made>(make([&watch](double share) { return watch(share); }));
        } catch (const Cancelled&) {
            watch.rethrow();
            throw;
        }
    }

    class Hold {
      public:
        explicit Hold(LockedRenderer& owner) : owner_(owner), lock_(owner.mutex_) {
            owner_.held_after_forks_ = Released::forks();
            owner_.holder_ = std::this_thread::get_id();
        }
        ~Hold() { owner_.holder_ = std::thread::id(); }
        Hold(const Hold&) = delete;
        Hold& operator=(const Hold&) = delete;

      private:
        LockedRenderer& owner_;
        std::lock_guard<std::mutex> lock_;
    };

    /// Refuses what would wait for ever: for this thread itself, or for one that this process does not have.
    void refuse_held() const {
        const std::thread::id holder = holder_.load();
        if (holder == std::thread::id()) {
            return;
        }
        if (held_after_forks_ != Released::forks()) {
            throw Unsupported(
                Complaint{"Renderer: this renderer cannot be used here",
                          "a process that was forked while another thread drew with it",
                          "a process that is forked between pictures",
                          "start processes by spawn, or draw in the child with a new Renderer of backend \"cpu\""});
        }
        if (holder == std::this_thread::get_id()) {
            throw Unsupported(Complaint{"Renderer: another picture cannot be started",
                                        "a call from its own progress callback", "one picture at a time",
                                        "use a second Renderer inside the callback"});
        }
    }

    std::mutex mutex_;
    std::atomic<std::thread::id> holder_{};
    std::atomic<int> held_after_forks_{0};
    Renderer renderer_;
};

std::unique_ptr<LockedRenderer> make_renderer(const std::string& backend, std::optional<int> device,
                                              const std::string& precision, const std::string& tagging,
                                              const std::string& packing, const std::string& path,
                                              const std::map<std::string, bool>& effects, bool allow_inexact,
                                              int tile_size, int tags_per_clear, int threads,
                                              std::optional<double> max_error, std::optional<double> max_seconds) {
    RendererOptions options;
    options.backend = from_name("backend", backend, backends);
    options.device = device;
    options.precision = from_name("precision", precision, precisions);
    options.tagging = from_name("tagging", tagging, taggings);
    options.packing = from_name("packing", packing, packings);
    options.path = from_name("path", path, paths);
    options.effects = effects;
    options.allow_inexact = allow_inexact;
    options.tile_size = tile_size;
    options.tags_per_clear = tags_per_clear;
    options.threads = threads;
    options.max_error = max_error;
    options.max_seconds = max_seconds;
    const Released release;
    return std::make_unique<LockedRenderer>(options);
}

} // namespace

void register_renderer(py::module_& module) {
    module.attr("spot_columns") = spot_columns;
    module.def(
        "probe_pixels",
        [](std::array<int, 2> size, bool surfaces) {
            const ProbePixels probes = probe_pixels({size[0], size[1]}, surfaces);
            py::array_t<int> pixels({probes.pixels.size(), std::size_t{2}});
            std::copy_n(probes.pixels.front().data(), 2 * probes.pixels.size(), pixels.mutable_data());
            return py::make_tuple(pixels, probes.wanted, probes.batch);
        },
        py::kw_only(), py::arg("size"), py::arg("surfaces"));
    module.def("thinned",
               [](const Numbers& spots, std::size_t most) { return table_of(thinned(spots_of(spots), most)); });
    module.def(
        "choose_spots",
        [](const Numbers& spots, std::array<int, 2> size, bool surfaces, double stop, std::size_t seen) {
            const ProbePixels probes = probe_pixels({size[0], size[1]}, surfaces);
            return table_of(choose_spots(spots_of(spots), probes.points, stop, probes.every(seen)));
        },
        py::arg("spots"), py::kw_only(), py::arg("size"), py::arg("surfaces"), py::arg("stop"), py::arg("seen"));
    module.def(
        "light_errors",
        [](const Numbers& spots, bool absorbed, std::size_t lights, const Numbers& left, const Numbers& shown,
           std::array<int, 2> size, bool surfaces, std::size_t tried, std::size_t seen) {
            const auto numbers = [](const Numbers& table) {
                return std::vector<double>(table.data(), table.data() + table.size());
            };
            const LightLines lines{absorbed, static_cast<std::size_t>(left.shape(1)), lights, numbers(left),
                                   numbers(shown)};
            const std::size_t every = probe_pixels({size[0], size[1]}, surfaces).every(seen);
            const LightErrors errors = light_errors(spots_of(spots), lines, tried, every);
            return py::make_tuple(errors.shadows, errors.occlusion);
        },
        py::arg("spots"), py::arg("absorbed"), py::arg("lights"), py::arg("left"), py::arg("shown"), py::kw_only(),
        py::arg("size"), py::arg("surfaces"), py::arg("tried"), py::arg("seen"));
    py::class_<Stages>(module, "Stages").def_property_readonly("done", &Stages::done);
    py::class_<LockedRenderer>(module, "Renderer")
        .def(py::init(&make_renderer), py::kw_only(), py::arg("backend"), py::arg("device"), py::arg("precision"),
             py::arg("tagging"), py::arg("packing"), py::arg("path"), py::arg("effects"), py::arg("allow_inexact"),
             py::arg("tile_size"), py::arg("tags_per_clear"), py::arg("threads"), py::arg("max_error") = py::none(),
             py::arg("max_seconds") = py::none())
        .def("plan", &LockedRenderer::plan, py::arg("scene"), py::arg("camera"), py::kw_only(), py::arg("size"),
             py::arg("coverage"), py::arg("depth"))
        .def("render", &LockedRenderer::render, py::arg("scene"), py::arg("camera"), py::kw_only(), py::arg("size"),
             py::arg("coverage"), py::arg("depth"), py::arg("progress"))
        .def("estimate_error", &LockedRenderer::estimate_error, py::arg("image"), py::arg("scene"), py::arg("camera"),
             py::kw_only(), py::arg("progress"))
        .def("plan_light", &LockedRenderer::plan_light, py::arg("part"), py::arg("camera"), py::kw_only(),
             py::arg("size"))
        .def("light_pieces", &LockedRenderer::light_pieces, py::arg("part"), py::arg("camera"), py::kw_only(),
             py::arg("size"), py::arg("light"), py::arg("progress"))
        .def("light_spots", &LockedRenderer::light_spots, py::arg("part"), py::arg("camera"), py::kw_only(),
             py::arg("size"), py::arg("numbers"), py::arg("progress"))
        .def("light_lines", &LockedRenderer::light_lines, py::arg("part"), py::arg("camera"), py::kw_only(),
             py::arg("size"), py::arg("spots"), py::arg("number"), py::arg("progress"))
        .def("light_volumes", &LockedRenderer::light_volumes, py::arg("light"), py::arg("grids"), py::kw_only(),
             py::arg("progress"))
        .def("begin_stages", &LockedRenderer::begin_stages, py::arg("scene"), py::arg("camera"), py::kw_only(),
             py::arg("size"), py::arg("coverage"), py::arg("depth"), py::arg("first_seconds"), py::keep_alive<0, 1>())
        .def("next_stage", &LockedRenderer::next_stage, py::arg("stages"), py::kw_only(), py::arg("progress"));
}

} // namespace sheetsplat::bindings
