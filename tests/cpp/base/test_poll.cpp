#include "base/poll.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <stdexcept>
#include <thread>

namespace sheetsplat {
namespace {

void wait_a_moment() { std::this_thread::sleep_for(std::chrono::milliseconds(6)); }

TEST(Poll, AsksNobodyWithoutAScope) {
    wait_a_moment();
    EXPECT_NO_THROW(poll());
}

TEST(Poll, AsksAtOnceThenNowAndThenAndLetsTheAnswerThrough) {
    int asked = 0;
    bool refuse = false;
    const PollScope scope([&] {
        ++asked;
        if (refuse) {
            throw std::runtime_error("unwanted");
        }
    });
    poll();
    EXPECT_EQ(asked, 1);
    for (int i = 0; i < 1000; ++i) {
        poll();
    }
    EXPECT_LT(asked, 50) << "a thousand calls in a moment";
    refuse = true;
    wait_a_moment();
    EXPECT_THROW(poll(), std::runtime_error);
}

TEST(Poll, TheInnermostScopeOfAThreadCounts) {
    int outer_asked = 0, inner_asked = 0;
    const PollScope outer([&outer_asked] { ++outer_asked; });
    {
        const PollScope inner([&inner_asked] { ++inner_asked; });
        wait_a_moment();
        poll();
        std::thread([] {
            wait_a_moment();
            poll();
        }).join();
    }
    EXPECT_EQ(inner_asked, 1);
    EXPECT_EQ(outer_asked, 0);
    poll();
    EXPECT_EQ(outer_asked, 1);
}

TEST(Poll, StepsAskOnceInFourThousand) {
    int asked = 0;
    const PollScope scope([&asked] { ++asked; });
    wait_a_moment();
    for (std::size_t i = 1; i < 4096; ++i) {
        poll_at(i);
    }
    EXPECT_EQ(asked, 0);
    poll_at(4096);
    EXPECT_EQ(asked, 1);
}

} // namespace
} // namespace sheetsplat
