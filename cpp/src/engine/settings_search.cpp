#include "settings_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/checks.hpp"
#include "sheetsplat/error.hpp"
#include "sheetsplat/renderer.hpp"

namespace sheetsplat {

namespace {

/// Of the error that is aimed at, what the stop may have: squares add up, so this leaves 0.92 to the rest.
constexpr double stop_share = 0.4;
/// Bounds of 1 - A_stop: above the first a stop saves no more time, below the second it is left out.
constexpr double largest_left = 0.1;
constexpr double smallest_left = 1e-6;
constexpr int most_stops = 4;
/// Between a slice distance that suffices and one that does not.
constexpr int most_steps = 3;
constexpr double nearly = 0.97;
constexpr double least_gain = 1.08;
constexpr double lowest_order = 0.5;
/// The search of a kind ends where halving the slice distance twice leaves more than this of its error, or where the
/// finest slices would not suffice though errors fell faster by this much of an order than they do.
constexpr double stalled = 0.8;
constexpr double faster_order = 0.75;
/// Bisection steps for the slice distance of a time.
constexpr int time_steps = 24;

Settings at(const Settings& kind, const Settings& start, double spacing) {
    Settings settings = kind;
    settings.slice_spacing = start.slice_spacing * spacing;
    return settings;
}

std::vector<Settings> kinds(const Settings& start, const Freedom& freedom) {
    std::vector<Settings> all{start};
    if (freedom.preintegration) {
        Settings kind = start;
        kind.preintegration = true;
        all.push_back(kind);
        kind.second_order = true;
        all.push_back(kind);
    }
    if (freedom.sampling) {
        Settings kind = start;
        kind.sampling = Sampling::slab;
        all.push_back(kind);
    }
    return all;
}

/// A_stop whose error is the given one, where it is in proportion to 1 - A_stop.
double stop_for(double wanted, const Settings& settings, double error) {
    if (error <= 0.0) {
        return settings.opacity_stop;
    }
    const double left = (1.0 - settings.opacity_stop) * wanted / error;
    return left < smallest_left ? 1.0 : 1.0 - std::min(left, std::max(largest_left, 1.0 - settings.opacity_stop));
}

class Search {
  public:
    Search(const Settings& start, const Freedom& freedom, Judge& judge)
        : start_(start), freedom_(freedom), judge_(judge) {}

    Choice for_error(double most, double aimed_share) {
        aim_ = aimed_share * most;
        best_.seconds = std::numeric_limits<double>::infinity();
        const Judge::Floor floor = judge_.floor();
        if (floor.error > aim_) {
            throw Unsupported(Complaint{option_ref("max_error") + " cannot be reached",
                                        floor.cause + " = " + text_of(floor.error, 3) + " alone, with any settings",
                                        option_ref("max_error", text_of(most, 3)) + ", less a margin for safety",
                                        floor.advice});
        }
        Settings start = start_;
        const double stopped = start.opacity_stop < 1.0 ? judge_.stop_error(start) : 0.0;
        if (freedom_.stop && stopped > 0.0) {
            start.opacity_stop = stop_within(stop_share * aim_, start, stopped);
        } else if (stopped > most) {
            throw InvalidInput(
                Complaint{option_ref("max_error") + " cannot be kept with this " + option_ref("opacity_stop"),
                          option_ref("opacity_stop", text_of(start.opacity_stop, 3)) +
                              ", which alone causes an error of " + text_of(stopped, 3),
                          option_ref("max_error", text_of(most, 3)), "leave out " + option_ref("opacity_stop")});
        }
        for (const Settings& kind : kinds(start, freedom_)) {
            look(kind);
        }
        if (!std::isfinite(best_.seconds)) {
            if (least_ > most) {
                give_up(most);
            }
            // Without the margin that is aimed at, but kept.
            take(least_at_, least_);
        }
        return best_;
    }

    Choice for_time(double most) {
        best_.error = std::numeric_limits<double>::infinity();
        best_.seconds_kept = false;
        // If the stop caused most of the error, all kinds would have about the same error.
        Settings start = start_;
        start.opacity_stop = freedom_.stop ? 1.0 : start.opacity_stop;
        for (const Settings& kind : kinds(start, freedom_)) {
            look_within(kind, most);
        }
        if (freedom_.stop && start_.opacity_stop < 1.0) {
            Settings usual = best_.settings;
            usual.opacity_stop = start_.opacity_stop;
            const double stopped = judge_.stop_error(usual);
            best_.settings.opacity_stop =
                stopped > 0.0 ? stop_within(std::max(stop_share * best_.error, least_max_error), usual, stopped)
                              : usual.opacity_stop;
            best_.error = judge_.error(best_.settings).value_or(best_.error);
        }
        return best_;
    }

  private:
    void take(const Settings& settings, double error) {
        const double seconds = judge_.seconds(settings);
        if (seconds < best_.seconds) {
            best_.settings = settings;
            best_.error = error;
            best_.seconds = seconds;
        }
    }

    /// A_stop whose error is at most the given one. Measured, because opacity may jump past A_stop.
    double stop_within(double most, Settings settings, double error) {
        const double usual = settings.opacity_stop;
        const bool suffices = error <= most;
        for (int n = 0; n < most_stops && settings.opacity_stop < 1.0; ++n) {
            const double before = settings.opacity_stop;
            settings.opacity_stop = stop_for(most, settings, error);
            if (settings.opacity_stop >= before && suffices) {
                return before;
            }
            error = judge_.stop_error(settings);
            if (error <= most) {
                return settings.opacity_stop;
            }
            if (suffices) {
                return usual;
            }
        }
        return 1.0;
    }

    /// From errors at 4, 2 and 1 times a slice distance: true where closer slices will not reach the error either.
    [[nodiscard]] bool is_hopeless(double first, double second, double third, double fine) const {
        if (third > stalled * first) {
            return true;
        }
        // The better of the two halvings, because one error may be small by chance.
        const double order = std::max({std::log2(first / second), std::log2(second / third), 1.0}) + faster_order;
        return third * std::pow(finest_spacing / fine, order) > aim_;
    }

    /// The finest slices of a kind that are faster than the best settings so far; none where the kind is never faster.
    std::optional<double> finest_that_is_faster(const Settings& kind) {
        const auto is_faster = [&](double spacing) {
            return judge_.seconds(at(kind, start_, spacing)) < best_.seconds;
        };
        if (is_faster(finest_spacing)) {
            return finest_spacing;
        }
        if (!is_faster(coarsest_spacing)) {
            return std::nullopt;
        }
        double low = std::log(finest_spacing), high = std::log(coarsest_spacing);
        for (int n = 0; n < time_steps; ++n) {
            const double middle = 0.5 * (low + high);
            (is_faster(std::exp(middle)) ? high : low) = middle;
        }
        return std::exp(high);
    }

    /// The largest slice distance of a kind that keeps the error.
    void look(const Settings& kind) {
        const auto error = [&](double spacing) {
            const std::optional<double> found = judge_.error(at(kind, start_, spacing));
            if (found && *found < least_) {
                least_ = *found;
                least_at_ = at(kind, start_, spacing);
            }
            return found;
        };
        const bool first = !std::isfinite(best_.seconds);
        const std::optional<double> least = first ? finest_spacing : finest_that_is_faster(kind);
        if (!least) {
            return;
        }
        // Errors grow with the slice distance: a kind that is not exact enough where it takes as long is never chosen.
        double fine = first || !freedom_.spacing ? 1.0 : *least;
        std::optional<double> found = error(fine);
        if (!found) {
            return;
        }
        best_.looked_at.push_back(kind_of(kind));
        if (!freedom_.spacing) {
            if (*found <= aim_) {
                take(at(kind, start_, 1.0), *found);
            }
            return;
        }
        double coarse = fine, fine_error = *found, coarse_error = 0.0, before = 0.0;
        while (fine_error > aim_) {
            if (before > 0.0 && is_hopeless(before, coarse_error, fine_error, fine)) {
                return;
            }
            before = coarse_error;
            coarse = fine;
            coarse_error = fine_error;
            fine *= 0.5;
            if (fine < *least) {
                return;
            }
            found = error(fine);
            if (!found) {
                return;
            }
            fine_error = *found;
        }
        while (coarse_error == 0.0 && fine < coarsest_spacing) {
            coarse = std::min(2.0 * fine, coarsest_spacing);
            found = error(coarse);
            if (!found) {
                break;
            }
            if (*found <= aim_) {
                fine = coarse;
                fine_error = *found;
            } else {
                coarse_error = *found;
            }
        }
        take(at(kind, start_, fine), fine_error);
        if (coarse_error == 0.0) {
            return;
        }
        for (int n = 0; n < most_steps; ++n) {
            const double order =
                std::max(lowest_order, std::log(coarse_error / std::max(fine_error, 1e-12)) / std::log(coarse / fine));
            const double step = std::pow(nearly * aim_ / std::max(fine_error, 1e-12), 1.0 / order);
            const double between = std::min(fine * step, nearly * coarse);
            if (between < least_gain * fine) {
                return;
            }
            found = error(between);
            if (found && *found <= aim_) {
                fine = between;
                fine_error = *found;
                take(at(kind, start_, fine), fine_error);
            } else {
                coarse = between;
                coarse_error = std::max(found.value_or(coarse_error), 1.001 * aim_);
            }
        }
    }

    /// The smallest slice distance of a kind that keeps the time.
    void look_within(const Settings& kind, double most) {
        double spacing = 1.0;
        const auto kept = [&](double candidate) { return judge_.seconds(at(kind, start_, candidate)) <= most; };
        if (freedom_.spacing) {
            double low = std::log(finest_spacing), high = std::log(coarsest_spacing);
            if (kept(finest_spacing)) {
                high = low;
            }
            for (int n = 0; n < time_steps && high > low; ++n) {
                const double middle = 0.5 * (low + high);
                (kept(std::exp(middle)) ? high : low) = middle;
            }
            spacing = std::exp(high);
        }
        const bool in_time = kept(spacing);
        if (!in_time && best_.seconds_kept) {
            return;
        }
        const Settings settings = at(kind, start_, spacing);
        const std::optional<double> error = judge_.error(settings);
        if (!error) {
            return;
        }
        best_.looked_at.push_back(kind_of(kind));
        const double seconds = judge_.seconds(settings);
        const bool first = !std::isfinite(best_.error);
        // Of those that are too slow, the fastest.
        const bool better = in_time != best_.seconds_kept ? in_time
                            : in_time                     ? *error < best_.error
                                                          : seconds < best_.seconds;
        if (first || better) {
            best_.settings = settings;
            best_.error = *error;
            best_.seconds = seconds;
            best_.seconds_kept = in_time;
        }
    }

    [[noreturn]] void give_up(double most) const {
        const std::string reached = "errors down to " + text_of(least_, 3) + ", by " + kind_of(least_at_) +
                                    " of slices " + text_of(least_at_.slice_spacing, 3) + " apart";
        if (!freedom_.spacing) {
            throw InvalidInput(Complaint{
                option_ref("max_error") + " cannot be kept with this " + option_ref("slice_spacing"),
                option_ref("slice_spacing", text_of(start_.slice_spacing, 3)) + ", with " + reached,
                option_ref("max_error", text_of(most, 3)),
                "leave out " + option_ref("slice_spacing") + ", or allow a larger " + option_ref("max_error")});
        }
        throw Unsupported(Complaint{option_ref("max_error") + " cannot be reached", reached,
                                    option_ref("max_error", text_of(most, 3)),
                                    "allow a larger " + option_ref("max_error") + "; " +
                                        option_ref("precision", "float64") + " may help where slices are many"});
    }

    const Settings start_;
    const Freedom freedom_;
    Judge& judge_;
    double aim_ = 0.0;
    Choice best_;
    double least_ = std::numeric_limits<double>::infinity();
    Settings least_at_;
};

} // namespace

std::string kind_of(const Settings& settings) {
    const char* sampling = settings.sampling == Sampling::slab ? "slab" : "point";
    if (!settings.preintegration) {
        return std::string(sampling) + " sampling";
    }
    return std::string(settings.second_order ? "second-order" : "first-order") + " pre-integration of " + sampling +
           " samples";
}

Choice choose_settings(const Settings& start, const Freedom& freedom, const Goal& goal, Judge& judge) {
    Search search(start, freedom, judge);
    if (!goal.error) {
        return search.for_time(*goal.seconds);
    }
    if (!goal.seconds) {
        return search.for_error(*goal.error, goal.aimed_share);
    }
    Choice choice;
    bool reached = true;
    try {
        choice = search.for_error(*goal.error, goal.aimed_share);
    } catch (const Unsupported&) {
        reached = false;
    }
    if (!reached || choice.seconds > *goal.seconds) {
        choice = Search(start, freedom, judge).for_time(*goal.seconds);
        choice.error_kept = choice.error <= *goal.error;
    }
    return choice;
}

} // namespace sheetsplat
