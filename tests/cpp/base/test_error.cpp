#include <gtest/gtest.h>

#include "sheetsplat/error.hpp"

namespace sheetsplat {
namespace {

TEST(Complaint, joins_its_four_parts) {
    const Complaint complaint{"RegularField: the samples cannot be used", "NaN at sample (3, 0, 7)", "finite numbers",
                              "pass nan=\"skip\" to leave such samples out"};
    EXPECT_EQ(complaint.text(), "RegularField: the samples cannot be used: found NaN at sample (3, 0, 7); "
                                "wanted finite numbers; pass nan=\"skip\" to leave such samples out");
}

TEST(Complaint, leaves_empty_parts_out) {
    EXPECT_EQ((Complaint{"it failed", "", "", ""}.text()), "it failed");
    EXPECT_EQ((Complaint{"it failed", "3", "", ""}.text()), "it failed: found 3");
    EXPECT_EQ((Complaint{"it failed", "", "4", ""}.text()), "it failed: wanted 4");
    EXPECT_EQ((Complaint{"it failed", "", "", "try again"}.text()), "it failed: try again");
    EXPECT_EQ((Complaint{"", "3", "4", ""}.text()), "found 3; wanted 4");
    EXPECT_EQ((Complaint{}.text()), "");
}

TEST(Error, carries_the_text_and_can_be_told_apart) {
    const Complaint complaint{"it failed", "3", "4", "try again"};
    try {
        throw InvalidInput(complaint);
    } catch (const Error& error) {
        EXPECT_STREQ(error.what(), "it failed: found 3; wanted 4; try again");
        EXPECT_NE(dynamic_cast<const InvalidInput*>(&error), nullptr);
        EXPECT_EQ(dynamic_cast<const OutOfMemory*>(&error), nullptr);
    }
    EXPECT_STREQ(Unsupported("plain text").what(), "plain text");
    EXPECT_THROW(throw DeviceUnavailable(complaint), std::runtime_error);
}

} // namespace
} // namespace sheetsplat
