#include "testing/synthetic_sequence.h"

#include <algorithm>
#include <cmath>

#include "testing/synthetic_places.h"

namespace portolan {
namespace {

/// A part of the camera's path in the order in which it is filmed.
struct Segment {
  double from_s, to_s;  // on the path
  double black_s = 0;   // if positive: the lens is covered for so long, the camera waits at from_s
};

struct Scene {
  SyntheticWorld world;
  CameraPath path;
  std::vector<Segment> segments;  // empty: the whole path
};

TownOptions TownFor(const SequenceOptions& options) {
  TownOptions town;
  town.seed = options.seed;
  town.texture_px = options.texture_px;
  town.repeat_facades = options.repeat_facades;
  return town;
}

/// Once around the middle block, counter-clockwise, and on along the first street and round its corner again.
Scene MakeTownScene(const SequenceOptions& options) {
  const TownOptions town = TownFor(options);
  const double x = (town.block_x + town.street_width) / 2, y = (town.block_y + town.street_width) / 2;
  const std::vector<Eigen::Vector2d> corners = {{-0.3 * x, -y}, {x, -y}, {x, y},      {-x, y},
                                                {-x, -y},       {x, -y}, {x, 0.3 * y}};
  return {MakeTown(town), MakeRoadPath(corners, RoadOptions()), {}};
}

Scene MakeStreetScene(const SequenceOptions& options) {
  const TownOptions town = TownFor(options);
  const double lane = (town.block_y + town.street_width) / 2 - 1.5;  // right of the middle of the street
  const double end = 1.1 * (town.block_x + town.street_width);
  return {MakeTown(town), MakeRoadPath({{-end, lane}, {end, lane}}, RoadOptions()), {}};
}

constexpr double kRoomLap = 36;  // s for a turn of the camera in the room

/// Hand-held: around the middle of the room, looking outwards and about.
CameraPath MakeRoomPath(double laps) {
  constexpr double kInterval = 0.5;
  std::vector<CameraStance> stances;
  for (int i = 0; i * kInterval <= laps * kRoomLap; ++i) {
    const double t = i * kInterval, angle = 2 * M_PI * t / kRoomLap;
    CameraStance stance;
    // The wobble is slower than the way around, so that the camera never stops: it turns, and turning alone shows no
    // depth.
    stance.position_in_world = {1.5 * std::cos(angle) + 0.1 * std::cos(1.1 * t),
                                1.0 * std::sin(angle) + 0.1 * std::sin(0.9 * t), 1.4 + 0.12 * std::sin(0.7 * t)};
    stance.yaw = angle + 0.12 * std::sin(0.5 * t);
    stance.pitch = -0.15 + 0.08 * std::sin(0.6 * t);
    stance.roll = 0.03 * std::sin(0.8 * t);
    stances.push_back(stance);
  }
  return CameraPath(std::move(stances), kInterval);
}

SyntheticWorld MakeRoomFor(const SequenceOptions& options) {
  RoomOptions room;
  room.seed = options.seed;
  room.texture_px = options.texture_px;
  return MakeRoom(room);
}

Scene MakeRoomScene(const SequenceOptions& options) {
  return {MakeRoomFor(options), MakeRoomPath(1.25), {}};
}

/// The room's way, cut: the first third, darkness, on from where nothing of it is seen, and around to the first third
/// again.
Scene MakeBlackoutScene(const SequenceOptions& options) {
  const double seen = 0.35 * kRoomLap, elsewhere = 0.6 * kRoomLap, end = 1.35 * kRoomLap;
  constexpr double kDarkness = 0.8;
  return {MakeRoomFor(options), MakeRoomPath(1.4), {{0, seen}, {elsewhere, elsewhere, kDarkness}, {elsewhere, end}}};
}

/// To and fro along one plane, with changing distance and slant.
Scene MakeWallScene(const SequenceOptions& options) {
  constexpr double kInterval = 0.5, kDuration = 26;
  std::vector<CameraStance> stances;
  for (int i = 0; i * kInterval <= kDuration; ++i) {
    const double t = i * kInterval, phase = 2 * M_PI * t / kDuration;
    CameraStance stance;
    stance.position_in_world = {-3.0 + 0.4 * std::sin(0.6 * t), 3.2 * std::cos(phase), 1.5 + 0.4 * std::sin(2 * phase)};
    stance.yaw = 0.2 * std::sin(0.5 * t);
    stance.pitch = 0.1 * std::sin(0.4 * t);
    stances.push_back(stance);
  }
  WallOptions wall;
  wall.seed = options.seed;
  wall.texture_px = options.texture_px;
  return {MakeWall(wall), CameraPath(std::move(stances), kInterval), {}};
}

double SmoothStep(double t) {
  const double x = std::clamp(t, 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

/// Sideways across the room, then a look right and left without any translation, then back.
Scene MakeRotationScene(const SequenceOptions& options) {
  constexpr double kInterval = 0.25, kMove = 6, kTurn = 10, kPause = 2, kWay = 1.6, kAngle = 0.6;
  std::vector<CameraStance> stances;
  for (int i = 0; i * kInterval <= 2 * kMove + kTurn + 2 * kPause; ++i) {
    const double t = i * kInterval;
    const double turn = std::clamp((t - kMove - kPause) / kTurn, 0.0, 1.0);
    const double way = SmoothStep(t / kMove) - SmoothStep((t - kMove - kTurn - 2 * kPause) / kMove);
    CameraStance stance;
    stance.position_in_world = {-1.4, -0.5 * kWay + kWay * way, 1.4};
    stance.yaw = kAngle * std::sin(2 * M_PI * SmoothStep(turn));
    stance.pitch = -0.1;
    stances.push_back(stance);
  }
  return {MakeRoomFor(options), CameraPath(std::move(stances), kInterval), {}};
}

struct SceneEntry {
  SceneDescription description;
  Scene (*make)(const SequenceOptions&);
};

const std::vector<SceneEntry>& Scenes() {
  static const std::vector<SceneEntry> scenes = {
      {{"town", "a lap and a third around a block of a town, straight streets and corners"}, MakeTownScene},
      {{"street", "straight down one street of the town"}, MakeStreetScene},
      {{"room", "a hand-held look around a furnished room, one turn and a quarter"}, MakeRoomScene},
      {{"wall", "to and fro along one planar wall"}, MakeWallScene},
      {{"rotation", "room: sideways, then pure rotation right and left, then back"}, MakeRotationScene},
      {{"blackout", "room: frames go black, the camera goes on elsewhere and comes back later"}, MakeBlackoutScene}};
  return scenes;
}

std::vector<SyntheticFrame> MakeFrames(const Scene& scene, const SequenceOptions& options) {
  std::vector<Segment> segments = scene.segments;
  if (segments.empty()) segments.push_back({0, scene.path.duration_s()});
  std::vector<SyntheticFrame> frames;
  for (const Segment& segment : segments) {
    const bool black = segment.black_s > 0;
    const double duration = black ? segment.black_s : (segment.to_s - segment.from_s) / options.speed;
    const int count = static_cast<int>(duration * options.fps);
    for (int i = 0; i < count; ++i) {
      if (options.num_frames > 0 && static_cast<int>(frames.size()) >= options.num_frames) return frames;
      SyntheticFrame frame;
      frame.stamp = Timestamp::FromSeconds(static_cast<double>(frames.size()) / options.fps);
      frame.path_s = black ? segment.from_s : segment.from_s + i * options.speed / options.fps;
      frame.world_from_camera = scene.path.At(frame.path_s);
      frame.black = black;
      frames.push_back(frame);
    }
  }
  return frames;
}

Error OptionError(const std::string& option, const std::string& value, const std::string& expected) {
  return Error{option + ": " + value + ", expected " + expected};
}

}  // namespace

Status SequenceOptions::Check() const {
  std::string names;
  bool known = false;
  for (const SceneDescription& description : SceneNames()) {
    known = known || description.name == scene;
    names += (names.empty() ? "" : ", ") + description.name;
  }
  if (!known) return OptionError("scene", "'" + scene + "'", "one of " + names);
  if (width < 64 || height < 64 || width > 4096 || height > 4096) {
    return OptionError("size", std::to_string(width) + "x" + std::to_string(height), "64 to 4096 pixels each way");
  }
  if (!(fps > 0 && fps <= 1000)) return OptionError("fps", std::to_string(fps), "more than 0, at most 1000");
  if (num_frames < 0) return OptionError("frames", std::to_string(num_frames), "0 (the whole way) or more");
  if (!(speed >= 0.01 && speed <= 100)) return OptionError("speed", std::to_string(speed), "0.01 to 100");
  if (texture_px < 64 || texture_px > 4096 || (texture_px & (texture_px - 1)) != 0) {
    return OptionError("texture", std::to_string(texture_px), "a power of two, 64 to 4096");
  }
  if (!LensWarp::IsPossible(MakeSyntheticCamera(width, height), lens)) {
    return OptionError("lens", std::to_string(lens.k1) + " " + std::to_string(lens.k2),
                       "k1 k2 with which every pixel sees something, near where it would without");
  }
  return sensor.Check();
}

const std::vector<SceneDescription>& SceneNames() {
  static const std::vector<SceneDescription> names = [] {
    std::vector<SceneDescription> list;
    for (const SceneEntry& scene : Scenes()) list.push_back(scene.description);
    return list;
  }();
  return names;
}

PinholeCamera MakeSyntheticCamera(int width, int height) {
  constexpr double kFocalPerWidth = 525.0 / 640.0;  // a usual hand-held camera
  const double focal = kFocalPerWidth * width;
  return {focal, focal, (width - 1) / 2.0, (height - 1) / 2.0, width, height};
}

Result<SyntheticSequence> SyntheticSequence::Make(const SequenceOptions& options) {
  if (const Status status = options.Check(); !status.ok()) return status.error();
  for (const SceneEntry& entry : Scenes()) {
    if (entry.description.name != options.scene) continue;
    Scene scene = entry.make(options);
    std::vector<SyntheticFrame> frames = MakeFrames(scene, options);
    if (frames.empty()) return OptionError("speed and fps", "no frame at all", "a slower camera or a higher rate");
    SyntheticSequence sequence(options, std::move(scene.world), std::move(scene.path));
    sequence.camera_ = MakeSyntheticCamera(options.width, options.height);
    sequence.frames_ = std::move(frames);
    return sequence;
  }
  PORTOLAN_CHECK(false) << " Check() passed the unknown scene " << options.scene;
  return Error{};
}

SequenceRenderer::SequenceRenderer(const SyntheticSequence& sequence)
    : sequence_(sequence),
      lens_(sequence.options().lens.IsNone()
                ? std::nullopt
                : std::make_optional<LensWarp>(sequence.camera(), sequence.options().lens)),
      renderer_(sequence.world(), lens_ ? lens_->ideal_camera() : sequence.camera()) {}

cv::Mat SequenceRenderer::RenderAt(const Rigid3d& world_from_camera) {
  const cv::Mat light = renderer_.Render(world_from_camera);
  return lens_ ? lens_->Apply(light) : light;
}

cv::Mat SequenceRenderer::RenderLight(const SyntheticFrame& frame) {
  const SequenceOptions& options = sequence_.options();
  if (frame.black) return cv::Mat::zeros(options.height, options.width, CV_32FC1);
  if (options.sensor.exposure_s <= 0) return RenderAt(frame.world_from_camera);
  constexpr int kExposureSteps = 5;  // pictures averaged over the open shutter
  cv::Mat light = cv::Mat::zeros(options.height, options.width, CV_32FC1);
  for (int i = 0; i < kExposureSteps; ++i) {
    const double offset = ((i + 0.5) / kExposureSteps - 0.5) * options.sensor.exposure_s * options.speed;
    light += RenderAt(sequence_.path().At(frame.path_s + offset)) / kExposureSteps;
  }
  return light;
}

cv::Mat SequenceRenderer::Render(size_t frame) {
  PORTOLAN_CHECK(frame < sequence_.frames().size()) << " frame " << frame << " of " << sequence_.frames().size();
  const SyntheticFrame& truth = sequence_.frames()[frame];
  const SequenceOptions& options = sequence_.options();
  const uint64_t noise_seed = options.seed * 0x9e3779b97f4a7c15ull + frame;  // SplitMix64's increment keeps seeds apart
  return Expose(RenderLight(truth), truth.stamp.Seconds(), noise_seed, options.sensor);
}

}  // namespace portolan
