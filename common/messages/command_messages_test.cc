#include "messages/command_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "messages/limits.h"
#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

TEST(CommandMessagesTest, CommandsOfAllKindsComeBack) {
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Command sent = RandomCommand(&random);
    const Result<Command> received = FromWire(ToWire(sent));
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_EQ(received->number, sent.number);
    EXPECT_EQ(received->sender, sent.sender);
    EXPECT_EQ(received->kind, sent.kind);
    EXPECT_EQ(received->map, sent.map);
    EXPECT_EQ(received->other, sent.other);
    EXPECT_EQ(received->epoch, sent.epoch);
    EXPECT_EQ(received->owner, sent.owner);
    EXPECT_EQ(received->robot, sent.robot);
    EXPECT_EQ(received->map_from_other.scale, sent.map_from_other.scale);
    EXPECT_EQ(received->map_from_other.rotation.coeffs(), sent.map_from_other.rotation.coeffs());
    EXPECT_EQ(received->map_from_other.translation, sent.map_from_other.translation);
  }
}

TEST(CommandMessagesTest, RefusesMalformedCommands) {
  Random random(2);
  Command command = RandomCommand(&random);
  command.kind = CommandKind::kGrantOwnership;
  ExpectRefused<wire::Command>(ToWire(command),
                               {
                                   {"sender is none", [](wire::Command* w) { w->sender(0); }},
                                   {"kind is 16", [](wire::Command* w) { w->kind(16); }},
                                   {"map is none", [](wire::Command* w) { w->map_id(0); }},
                                   {"owner is none", [](wire::Command* w) { w->owner(0); }},
                                   {"epoch of a grant is 0", [](wire::Command* w) { w->epoch(0); }},
                                   {"epoch is 281474976710657", [](wire::Command* w) { w->epoch(kMaxEpoch + 1); }},
                                   {"scale", [](wire::Command* w) { w->map_from_other().scale(-2); }},
                                   {"quaternion",
                                    [](wire::Command* w) {
                                      w->map_from_other().rotation({0, 0, 0, 0});
                                    }},
                               });
  command.kind = CommandKind::kFuseMaps;
  ExpectRefused<wire::Command>(ToWire(command), {
                                                    {"other is none", [](wire::Command* w) { w->other(0); }},
                                                    {"with itself", [](wire::Command* w) { w->other(w->map_id()); }},
                                                });
}

TEST(CommandMessagesTest, CommandsToARobotNeedNoMap) {
  for (const CommandKind kind : {CommandKind::kNewMap, CommandKind::kPause, CommandKind::kResume,
                                 CommandKind::kLocalizeOnly, CommandKind::kMapAgain, CommandKind::kShutDown}) {
    Command command;
    command.sender = ProcessId(1, 2, 3);
    command.kind = kind;
    EXPECT_TRUE(FromWire(ToWire(command)).ok()) << static_cast<int>(kind);
  }
}

TEST(CommandMessagesTest, CommandsToAProcessNameIt) {
  for (const CommandKind kind : {CommandKind::kDrain, CommandKind::kAppointMapper, CommandKind::kAppointLoopCloser,
                                 CommandKind::kAppointAtlasServer}) {
    Command command;
    command.sender = ProcessId(1, 2, 3);
    command.owner = ProcessId(1, 4, 1);
    command.kind = kind;
    EXPECT_TRUE(FromWire(ToWire(command)).ok()) << static_cast<int>(kind);
    ExpectRefused<wire::Command>(ToWire(command), {{"owner is none", [](wire::Command* w) { w->owner(0); }}});
  }
}

TEST(CommandMessagesTest, RequestsAndRepliesComeBack) {
  Random random(3);
  const Request request = RandomRequest(&random);
  const Result<Request> asked = FromWire(ToWire(request));
  ASSERT_TRUE(asked.ok());
  EXPECT_EQ(asked->id, request.id);
  EXPECT_EQ(asked->sender, request.sender);
  EXPECT_EQ(asked->kind, request.kind);
  EXPECT_EQ(asked->map, request.map);
  EXPECT_EQ(asked->other, request.other);
  EXPECT_EQ(asked->map_from_other.translation, request.map_from_other.translation);
  EXPECT_EQ(asked->map_from_other.scale, request.map_from_other.scale);
  EXPECT_EQ(asked->argument, request.argument);

  Reply reply = RandomReply(&random);
  for (const bool ok : {false, true}) {
    reply.ok = ok;
    const Result<Reply> answered = FromWire(ToWire(reply));
    ASSERT_TRUE(answered.ok());
    EXPECT_EQ(answered->id, reply.id);
    EXPECT_EQ(answered->sender, reply.sender);
    EXPECT_EQ(answered->ok, ok);
    EXPECT_EQ(answered->reason, reply.reason);
    EXPECT_EQ(answered->text, reply.text);
  }
}

TEST(CommandMessagesTest, RefusesMalformedRequestsAndReplies) {
  Random random(4);
  ExpectRefused<wire::Request>(
      ToWire(RandomRequest(&random)),
      {
          {"id is none", [](wire::Request* w) { w->id(0); }},
          {"sender is none", [](wire::Request* w) { w->sender(0); }},
          {"kind is empty", [](wire::Request* w) { w->kind(""); }},
          {"scale", [](wire::Request* w) { w->map_from_other().scale(0); }},
          {"argument holds", [](wire::Request* w) { w->argument("\xff"); }},
          {"length of argument", [](wire::Request* w) { w->argument(std::string(kMaxLineBytes + 1, 'x')); }},
      });
  ExpectRefused<wire::Reply>(
      ToWire(RandomReply(&random)),
      {
          {"id is none", [](wire::Reply* w) { w->id(0); }},
          {"sender is none", [](wire::Reply* w) { w->sender(0); }},
          {"reason holds", [](wire::Reply* w) { w->reason("\x07"); }},
          {"length of text", [](wire::Reply* w) { w->text(std::string(kMaxTextBytes + 1, 'x')); }},
      });
}

}  // namespace
}  // namespace portolan
