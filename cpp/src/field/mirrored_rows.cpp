// Rows of a lattice with mirrored samples at their ends, and the lattices that a picture is drawn of in its place: with
// all mirrored samples, or without an end (conventions, section 2).

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>

#include "base/checks.hpp"
#include "base/memory.hpp"
#include "base/poll.hpp"
#include "mirrored.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/field.hpp"

namespace sheetsplat {

std::shared_ptr<const SampleArray> RegularField::with_ends(SampleArray&& samples) const {
    const std::size_t ends = mirrored_[2];
    if (ends == 0) {
        return std::make_shared<const SampleArray>(std::move(samples));
    }
    const auto [nk, nj, ni] = shape_;
    const bool bcc = options_.lattice == Lattice::bcc;
    std::vector<std::vector<std::size_t>> of(2);
    for (std::size_t odd = 0; odd < 2; ++odd) {
        for (std::size_t i = 0; i < ni + 2 * ends; ++i) {
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(i) - static_cast<std::ptrdiff_t>(ends);
            of[odd].push_back(bcc ? mirrored_index_bcc(at, ni, odd) : mirrored_index(at, ni));
        }
    }
    return std::visit(
        [&, nk = nk, nj = nj, ni = ni](auto& array) {
            using T = typename std::decay_t<decltype(array)>::value_type;
            const std::string what = "a volume with mirrored samples at the ends of its rows";
            const std::size_t row = ni + 2 * ends;
            const std::uint64_t count = checked_product(checked_product(nk, nj, what), row, what);
            require_memory(checked_product(count, sizeof(T), what), what,
                           "pass " + option_ref("boundary", "zero") + ", or use a smaller volume");
            // From the last row on, each row moves up: nothing is overwritten that is still to be read.
            // (Without being asked for less, a vector that grows takes twice its size.)
            array.reserve(count);
            array.resize(count);
            for (std::size_t r = nk * nj; r-- > 0;) {
                const std::vector<std::size_t>& from = of[(r / nj) % 2];
                T* to = array.data() + r * row;
                std::memmove(to + ends, array.data() + r * ni, ni * sizeof(T));
                for (std::size_t i = 0; i < ends; ++i) {
                    to[i] = to[ends + from[i]];
                    to[ends + ni + i] = to[ends + from[ends + ni + i]];
                }
            }
            return std::make_shared<const SampleArray>(std::move(array));
        },
        samples);
}

void RegularField::find_rows() {
    const std::size_t row = shape_[2] + 2 * mirrored_[2];
    for (std::size_t k = 0; k < shape_[0]; ++k) {
        layers_.push_back(k * shape_[1] * row + mirrored_[2]);
    }
    rows_.resize(1);
    for (std::size_t j = 0; j < shape_[1]; ++j) {
        rows_[0].push_back(j * row);
    }
}

RegularField::RegularField(const RegularField& inner, Mirrored)
    : samples_(inner.samples_), given_(inner.given_), options_(inner.options_), centres_world_(inner.centres_world_),
      steps_(inner.steps_), kernel_axes_(inner.kernel_axes_), value_range_(inner.value_range_),
      given_range_(inner.given_range_), prefilter_(inner.prefilter_), has_holes_(inner.has_holes_) {
    kernel_ = inner.kernel_;
    normalization_ = inner.normalization_;
    w0_ = inner.w0_;
    base_ = inner.base_;
    least_weight_ = inner.least_weight_;
    options_.boundary = Boundary::zero;
    const bool bcc = options_.lattice == Lattice::bcc;
    const auto& ends = inner.mirrored_;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        shape_[axis] = inner.shape_[axis] + 2 * ends[axis];
        options_.origin -= static_cast<double>(ends[axis]) * steps_[static_cast<glm::length_t>(2 - axis)];
    }
    const auto place = [](std::size_t n, std::size_t before) {
        return static_cast<std::ptrdiff_t>(n) - static_cast<std::ptrdiff_t>(before);
    };
    for (std::size_t k = 0; k < shape_[0]; ++k) {
        const std::size_t source = mirrored_index(place(k, ends[0]), inner.shape_[0]);
        layers_.push_back(inner.layers_[source] - ends[2]);
    }
    rows_.resize(bcc ? 2 : 1);
    for (std::size_t odd = 0; odd < rows_.size(); ++odd) {
        for (std::size_t j = 0; j < shape_[1]; ++j) {
            const std::ptrdiff_t at = place(j, ends[1]);
            const std::size_t source =
                bcc ? mirrored_index_bcc(at, inner.shape_[1], odd) : mirrored_index(at, inner.shape_[1]);
            rows_[odd].push_back(inner.rows_[0][source]);
        }
    }
    // Supports that do not reach into the domain are no kernels. Layers from the domain's first one on: distances to
    // it, in layers, are 0 inside.
    const double radius = options_.radius, squared = (bcc ? 2.0 : 1.0) * radius * radius;
    const auto beyond = [&](std::size_t axis, std::size_t n, std::size_t odd) {
        const bool halves = bcc && axis != 0;
        const double at = static_cast<double>(place(n, ends[axis])) * (halves ? 2.0 : 1.0) +
                          (halves ? static_cast<double>(odd) : 0.0);
        const double last = static_cast<double>(inner.shape_[axis]) * (halves ? 2.0 : 1.0) - 1.0;
        return std::max({0.0, -domain_in_layers - at, at - last - domain_in_layers});
    };
    extents_.resize(shape_[0] * shape_[1]);
    kernels_ = 0;
    std::visit(
        [&](const auto& array) {
            for (std::size_t k = 0; k < shape_[0]; ++k) {
                const std::size_t odd = bcc ? k % 2 : 0;
                const double z = beyond(0, k, 0);
                for (std::size_t j = 0; j < shape_[1]; ++j) {
                    const double y = beyond(1, j, odd);
                    const auto reaches = [&](std::size_t i) {
                        const double x = beyond(2, i, odd);
                        return x * x + y * y + z * z < squared;
                    };
                    const auto* values = array.data() + row(j, k);
                    const auto present = [&](std::size_t i) { return !has_holes_ || values[i] == values[i]; };
                    std::size_t begin = 0, end = shape_[2];
                    while (begin < end && !(reaches(begin) && present(begin))) {
                        ++begin;
                    }
                    while (end > begin && !(reaches(end - 1) && present(end - 1))) {
                        --end;
                    }
                    extents_[k * shape_[1] + j] = {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end)};
                    kernels_ += has_holes_ ? static_cast<std::size_t>(std::count_if(values + begin, values + end,
                                                                                    [](auto v) { return v == v; }))
                                           : end - begin;
                }
            }
        },
        *samples_);
    number_extents();
    find_outermost_rows();
}

void RegularField::number_extents() {
    std::vector<SampleRange> different;
    std::vector<std::uint8_t> numbers;
    numbers.reserve(extents_.size());
    for (const SampleRange& own : extents_) {
        const auto known = std::find_if(different.rbegin(), different.rend(), [&own](const SampleRange& other) {
            return other.begin == own.begin && other.end == own.end;
        });
        std::size_t number = different.size();
        if (known != different.rend()) {
            number = static_cast<std::size_t>(different.rend() - known) - 1;
        } else if (number > std::numeric_limits<std::uint8_t>::max()) {
            return;
        } else {
            different.push_back(own);
        }
        numbers.push_back(static_cast<std::uint8_t>(number));
    }
    extents_ = std::move(different);
    extents_.shrink_to_fit();
    extent_of_row_ = std::move(numbers);
}

void RegularField::find_outermost_rows() {
    const auto [nk, nj, ni] = shape_;
    // (Layers of a BCC lattice lie over the next but one.)
    const std::size_t apart = options_.lattice == Lattice::bcc ? 2 : 1;
    const auto extent = [&](std::size_t j, std::size_t k) { return kernels_of_row(j, k); };
    for (std::size_t k = 0; k < nk; ++k) {
        for (std::size_t j = 0; j < nj; ++j) {
            const SampleRange own = extent(j, k);
            const auto alike = [&own](const SampleRange& other) {
                return other.begin == own.begin && other.end == own.end;
            };
            // What lies in the middle between others is no corner.
            const bool in_layer = j > 0 && j + 1 < nj && alike(extent(j - 1, k)) && alike(extent(j + 1, k));
            const bool between_layers =
                k >= apart && k + apart < nk && alike(extent(j, k - apart)) && alike(extent(j, k + apart));
            if (own.begin < own.end && !in_layer && !between_layers) {
                outermost_rows_.push_back(static_cast<std::uint32_t>(k * nj + j));
            }
        }
    }
    outermost_rows_.shrink_to_fit();
}

RegularField::RegularField(const RegularField& inner, Endless)
    : samples_(inner.samples_), shape_(inner.shape_), options_(inner.options_), centres_world_(inner.centres_world_),
      steps_(inner.steps_), kernel_axes_(inner.kernel_axes_), mirrored_(inner.mirrored_), layers_(inner.layers_),
      rows_(inner.rows_), extents_(inner.extents_), extent_of_row_(inner.extent_of_row_),
      value_range_(inner.given_range_), given_range_(inner.given_range_), kernels_(inner.kernels_),
      has_holes_(inner.has_holes_) {
    kernel_ = inner.kernel_;
    normalization_ = options_.normalization;
    w0_ = options_.w0;
    least_weight_ = options_.least_weight;
    options_.boundary = Boundary::zero;
    options_.base = 0.0;
}

std::shared_ptr<const RegularField> RegularField::without_end() const {
    if (!prefilter_) {
        return std::shared_ptr<const RegularField>(new RegularField(*this, Endless{}));
    }
    RegularFieldOptions options = options_;
    options.boundary = Boundary::zero;
    options.base = 0.0;
    options.normalization = Normalization::lattice;
    options.value_range.reset();
    SampleArray samples = *given_;
    return std::make_shared<const RegularField>(std::move(samples), shape_, options);
}

std::array<double, 2> RegularField::range_near_ends(std::size_t samples) const {
    const auto [nk, nj, ni] = shape_;
    const auto inner = [samples](std::size_t n, std::size_t count) { return n >= samples && n + samples < count; };
    const std::size_t left = std::min(samples, ni), right = std::max(left, ni - left);
    return std::visit(
        [&, nk = nk, nj = nj, ni = ni](const auto& array) {
            using T = typename std::decay_t<decltype(array)>::value_type;
            T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
            const auto look = [&](const T* from, const T* end) {
                // (A NaN is not beyond anything.)
                for (; from != end; ++from) {
                    low = *from < low ? *from : low;
                    high = *from > high ? *from : high;
                }
            };
            for (std::size_t k = 0; k < nk; ++k) {
                for (std::size_t j = 0; j < nj; ++j) {
                    const T* values = array.data() + row(j, k);
                    if (inner(k, nk) && inner(j, nj)) {
                        look(values, values + left);
                        look(values + right, values + ni);
                    } else {
                        look(values, values + ni);
                    }
                }
                poll();
            }
            return low > high ? std::array<double, 2>{0.0, 0.0}
                              : std::array<double, 2>{static_cast<double>(low) - counted_from(),
                                                      static_cast<double>(high) - counted_from()};
        },
        *samples_);
}

std::shared_ptr<const RegularField> RegularField::with_mirrored() const {
    if (!domain_) {
        return nullptr;
    }
    const std::string what = "the rows of a volume with mirrored samples";
    const auto rows = checked_product(shape_[0] + 2 * mirrored_[0], shape_[1] + 2 * mirrored_[1], what);
    require_memory(checked_product(rows, sizeof(SampleRange), what), what,
                   "pass " + option_ref("boundary", "zero") + ", or use a smaller volume");
    return std::shared_ptr<const RegularField>(new RegularField(*this, Mirrored{}));
}

std::int64_t RegularField::sample_of(std::int64_t number) const {
    if (number < 0 || mirrored_[2] == 0) {
        return number;
    }
    const std::size_t length = shape_[2] + 2 * mirrored_[2];
    const auto at = static_cast<std::size_t>(number);
    const std::size_t row = at / length;
    const auto i = static_cast<std::ptrdiff_t>(at % length) - static_cast<std::ptrdiff_t>(mirrored_[2]);
    const std::size_t source = options_.lattice == Lattice::bcc
                                   ? mirrored_index_bcc(i, shape_[2], (row / shape_[1]) % 2)
                                   : mirrored_index(i, shape_[2]);
    return static_cast<std::int64_t>(row * shape_[2] + source);
}

} // namespace sheetsplat
