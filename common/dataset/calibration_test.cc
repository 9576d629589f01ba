#include "dataset/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

constexpr char kOwn[] =
    "model: pinhole\nwidth: 640\nheight: 480\nfx: 585.5\nfy: 585.25\ncx: 320\ncy: 240\ndistortion: [0.1, -0.2, 0.01, "
    "0.02, 0.03]\nfps: 30\n";
constexpr char kEuroc[] =
    "# General sensor definitions.\nsensor_type: camera\ncomment: VI-Sensor cam0 (MT9M034)\nT_BS:\n  cols: 4\n  rows: "
    "4\n"
    "  data: [1, 0, 0, 0,\n         0, 1, 0, 0,\n         0, 0, 1, 0,\n         0, 0, 0, 1]\nrate_hz: 20\nresolution: "
    "[752, 480]\n"
    "camera_model: pinhole\nintrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv\n"
    "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]\n";
constexpr char kRos[] =
    "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [430.2, 0, "
    "306.7, 0, 430.5, 227.4, 0, 0, 1]\n"
    "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.33, 0.11, 0.001, 0.002, "
    "0]\n"
    "projection_matrix: {rows: 3, cols: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}\n";
/// As `ros2 topic echo --once` prints the message.
constexpr char kRosMessage[] =
    "header:\n  stamp:\n    sec: 1700000000\n    nanosec: 5\n  frame_id: head\nheight: 480\nwidth: 640\n"
    "distortion_model: plumb_bob\nd:\n- -0.33\n- 0.11\n- 0.001\n- 0.002\n- 0.04\n"
    "k:\n- 430.2\n- 0.0\n- 306.7\n- 0.0\n- 430.5\n- 227.4\n- 0.0\n- 0.0\n- 1.0\n"
    "r:\n- 1.0\n- 0.0\n- 0.0\n- 0.0\n- 1.0\n- 0.0\n- 0.0\n- 0.0\n- 1.0\n"
    "p:\n- 400.0\n- 0.0\n- 300.0\n- 0.0\n- 0.0\n- 400.0\n- 220.0\n- 0.0\n- 0.0\n- 0.0\n- 1.0\n- 0.0\n"
    "binning_x: 0\nbinning_y: 0\n"
    "roi:\n  x_offset: 0\n  y_offset: 0\n  height: 0\n  width: 0\n  do_rectify: false\n---\n";
constexpr char kOrbSlam2[] =
    "%YAML:1.0\n\n# Camera Parameters\nCamera.fx: 517.306408\nCamera.fy: 516.469215\nCamera.cx: 318.643040\nCamera.cy: "
    "255.313989\n\n"
    "Camera.k1: 0.262383\nCamera.k2: -0.953104\nCamera.p1: -0.005358\nCamera.p2: 0.002628\nCamera.k3: "
    "1.163314\n\nCamera.fps: 30.0\n"
    "Camera.RGB: 1\nORBextractor.nFeatures: 1000\n";
constexpr char kOrbSlam3[] =
    "%YAML:1.0\n---\nFile.version: \"1.0\"\nCamera.type: \"KannalaBrandt8\"\nCamera1.fx: 190.97\nCamera1.fy: "
    "190.97\nCamera1.cx: 254.93\n"
    "Camera1.cy: 256.89\nCamera1.k1: 0.0034\nCamera1.k2: 0.0007\nCamera1.k3: -0.002\nCamera1.k4: 0.0002\nCamera.width: "
    "512\nCamera.height: 512\nCamera.fps: 20\n"
    "IMU.T_b_c1: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: f\n   data: [1.0, 0.0]\n";
constexpr char kKitti[] =
    "P0: 7.188560e+02 0.0 6.071928e+02 0.0 0.0 7.188560e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0\n"
    "P1: 7.188560e+02 0.0 6.071928e+02 -3.861448e+02 0.0 7.188560e+02 1.852157e+02 0.0 0.0 0.0 1.0 0.0\n"
    "P2: 7.070912e+02 0.0 6.018873e+02 4.688783e+01 0.0 7.070912e+02 1.831104e+02 1.178601e-01 0.0 0.0 1.0 "
    "6.203223e-03\n";

/// Replaces the first `from` of a text.
std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

class CalibrationTest : public testing::Test {
 protected:
  Result<CameraModel> Read(const std::string& text) { return ReadCalibration(folder_.Write("camera.yaml", text)); }
  /// The message without the file's path in front.
  std::string FailureOf(const std::string& text) {
    const Result<CameraModel> camera = Read(text);
    if (camera) return "no failure";
    const std::string path = folder_.Path("camera.yaml");
    EXPECT_THAT(camera.error().message, StartsWith(path));
    return camera.error().message.substr(std::min(path.size(), camera.error().message.size()));
  }
  /// kOwn with one line replaced.
  std::string OwnWith(const std::string& key, const std::string& line) {
    const std::string text = kOwn;
    const size_t start = text.find(key + ":");
    return text.substr(0, start) + line + text.substr(text.find('\n', start));
  }
  const TempFolder folder_;
};

TEST_F(CalibrationTest, ReadsItsOwnForm) {
  const auto camera = Read(kOwn);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole.width, 640);
  EXPECT_EQ(camera->pinhole.height, 480);
  EXPECT_EQ(camera->pinhole.fx, 585.5);
  EXPECT_EQ(camera->pinhole.fy, 585.25);
  EXPECT_EQ(camera->pinhole.cx, 320);
  EXPECT_EQ(camera->pinhole.cy, 240);
  EXPECT_EQ(camera->distortion, Distortion::kRadialTangential);
  EXPECT_THAT(camera->coefficients, ElementsAre(0.1, -0.2, 0.01, 0.02, 0.03));
  EXPECT_EQ(camera->fps, 30);
}

TEST_F(CalibrationTest, NoDistortionIsAPlainPinhole) {
  EXPECT_EQ(Read(OwnWith("distortion", "distortion: [0, 0, 0, 0]"))->distortion, Distortion::kNone);
  EXPECT_EQ(Read(OwnWith("distortion", ""))->distortion, Distortion::kNone);
  EXPECT_EQ(Read(OwnWith("fps", ""))->fps, 0);
}

TEST_F(CalibrationTest, FisheyeHasFourCoefficients) {
  std::string text = OwnWith("distortion", "distortion: [0.01, 0.02, 0.03, 0.04]");
  text.replace(text.find("pinhole"), 7, "fisheye");
  const auto camera = Read(text);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->distortion, Distortion::kKannalaBrandt4);
  EXPECT_THAT(camera->coefficients, ElementsAre(0.01, 0.02, 0.03, 0.04, 0));
}

TEST_F(CalibrationTest, ReadsEuroc) {
  const auto camera = Read(kEuroc);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole.fx, 458.654);
  EXPECT_EQ(camera->pinhole.cy, 248.375);
  EXPECT_EQ(camera->pinhole.width, 752);
  EXPECT_EQ(camera->distortion, Distortion::kRadialTangential);
  EXPECT_THAT(camera->coefficients, ElementsAre(-0.28, 0.07, 0.0002, 1.7e-05, 0));
  EXPECT_EQ(camera->fps, 20);
}

TEST_F(CalibrationTest, ReadsEurocFisheye) {
  const auto camera = Read(Replaced(kEuroc, "radial-tangential", "equidistant"));
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->distortion, Distortion::kKannalaBrandt4);
  EXPECT_THAT(camera->coefficients, ElementsAre(-0.28, 0.07, 0.0002, 1.7e-05, 0));
  EXPECT_EQ(camera->pinhole.fy, 457.296);
}

TEST_F(CalibrationTest, ReadsRosCameraInfo) {
  const auto camera = Read(kRos);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole.fx, 430.2);
  EXPECT_EQ(camera->pinhole.fy, 430.5);
  EXPECT_EQ(camera->pinhole.cx, 306.7);
  EXPECT_EQ(camera->pinhole.cy, 227.4);
  EXPECT_EQ(camera->pinhole.width, 640);
  EXPECT_EQ(camera->pinhole.height, 480);
  EXPECT_EQ(camera->distortion, Distortion::kRadialTangential);
  EXPECT_THAT(camera->coefficients, ElementsAre(-0.33, 0.11, 0.001, 0.002, 0));
}

TEST_F(CalibrationTest, ReadsRosCameraInfoFisheye) {
  for (const char* model : {"equidistant", "fisheye"}) {
    const auto camera = Read(Replaced(Replaced(kRos, "plumb_bob", model), "0.002, 0]", "0.002]"));
    ASSERT_TRUE(camera) << camera.error().message;
    EXPECT_EQ(camera->distortion, Distortion::kKannalaBrandt4) << model;
    EXPECT_THAT(camera->coefficients, ElementsAre(-0.33, 0.11, 0.001, 0.002, 0)) << model;
    EXPECT_EQ(camera->pinhole.cx, 306.7) << model;
  }
}

TEST_F(CalibrationTest, ReadsRosCameraInfoMessage) {
  const std::string without_end = Replaced(kRosMessage, "---\n", "");
  for (const std::string& text : {std::string(kRosMessage), without_end, "---\n" + without_end}) {
    const auto camera = Read(text);
    ASSERT_TRUE(camera) << camera.error().message;
    EXPECT_EQ(camera->pinhole, (PinholeCamera{430.2, 430.5, 306.7, 227.4, 640, 480}));
    EXPECT_EQ(camera->distortion, Distortion::kRadialTangential);
    EXPECT_THAT(camera->coefficients, ElementsAre(-0.33, 0.11, 0.001, 0.002, 0.04));
  }
  const auto fisheye = Read(Replaced(Replaced(kRosMessage, "plumb_bob", "equidistant"), "- 0.04\n", ""));
  ASSERT_TRUE(fisheye) << fisheye.error().message;
  EXPECT_EQ(fisheye->distortion, Distortion::kKannalaBrandt4);
  EXPECT_THAT(fisheye->coefficients, ElementsAre(-0.33, 0.11, 0.001, 0.002, 0));
  const auto rectified = Read(Replaced(kRosMessage, "d:\n- -0.33\n- 0.11\n- 0.001\n- 0.002\n- 0.04\n", "d: []\n"));
  ASSERT_TRUE(rectified) << rectified.error().message;
  EXPECT_EQ(rectified->distortion, Distortion::kNone);
}

TEST_F(CalibrationTest, NamesWhatIsWrongInARosMessage) {
  EXPECT_EQ(FailureOf(Replaced(kRosMessage, "- 430.2", "- 0.0")),
            ":15: k: expected [fx, 0, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0, found '0.0, 0.0, 306.7, 0.0, "
            "430.5, 227.4, 0.0, 0.0, 1.0'")
      << "what a driver without a calibration publishes";
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "- 430.2\n", "")), HasSubstr(":15: k: expected a list of 9 finite"));
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "k:", "K:")), HasSubstr(": key 'k' is missing"));
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "d:\n", "D:\n")), HasSubstr(": key 'd' is missing"));
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "- 0.04\n", "- 0.04\n- 0.0\n")),
              HasSubstr(":9: d: expected a list of 0 or 4 or 5 finite numbers"));
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "plumb_bob", "rational_polynomial")),
              HasSubstr(":8: distortion_model: expected plumb_bob or equidistant, found 'rational_polynomial'"));
  EXPECT_THAT(FailureOf(Replaced(kRosMessage, "height: 480", "height: 0")),
              HasSubstr(":6: height: expected a whole number of pixels"));
  EXPECT_EQ(FailureOf(std::string(kRosMessage) + kRosMessage), ": expected one YAML document, found 2");
}

TEST_F(CalibrationTest, ReadsOrbSlamWithItsOpenCvHeader) {
  const auto camera = Read(kOrbSlam2);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole.fx, 517.306408);
  EXPECT_EQ(camera->pinhole.width, 0) << "the file has none: the source fills it in";
  EXPECT_THAT(camera->coefficients, ElementsAre(0.262383, -0.953104, -0.005358, 0.002628, 1.163314));
  EXPECT_EQ(camera->fps, 30);
}

TEST_F(CalibrationTest, ReadsNewerOrbSlamFisheye) {
  const auto camera = Read(kOrbSlam3);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->distortion, Distortion::kKannalaBrandt4);
  EXPECT_EQ(camera->pinhole.width, 512);
  EXPECT_EQ(camera->pinhole.cx, 254.93);
  EXPECT_THAT(camera->coefficients, ElementsAre(0.0034, 0.0007, -0.002, 0.0002, 0));
}

TEST_F(CalibrationTest, RectifiedOrbSlamImagesHaveNoDistortion) {
  const auto camera = Read(Replaced(kOrbSlam3, "KannalaBrandt8", "Rectified"));
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->distortion, Distortion::kNone);
  EXPECT_EQ(camera->pinhole, (PinholeCamera{190.97, 190.97, 254.93, 256.89, 512, 512}));
  EXPECT_EQ(camera->fps, 20);
}

TEST_F(CalibrationTest, ReadsKittiWithoutASize) {
  const auto camera = Read(kKitti);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole.fx, 718.856);
  EXPECT_EQ(camera->pinhole.cx, 607.1928);
  EXPECT_EQ(camera->pinhole.cy, 185.2157);
  EXPECT_EQ(camera->pinhole.width, 0);
  EXPECT_EQ(camera->distortion, Distortion::kNone);
}

TEST_F(CalibrationTest, ReadsKittisOtherCameras) {
  const std::string path = folder_.Write("calib.txt", kKitti);
  const auto camera = ReadCalibration(path, 2);
  ASSERT_TRUE(camera) << camera.error().message;
  EXPECT_EQ(camera->pinhole, (PinholeCamera{707.0912, 707.0912, 601.8873, 183.1104, 0, 0}));
  EXPECT_EQ(ReadCalibration(path, 1)->pinhole.fx, 718.856);
  EXPECT_EQ(ReadCalibration(path, 3).error().message, path + ": row 'P3:' is missing");
  folder_.Write("calib.txt", Replaced(kKitti, "6.203223e-03", "nan"));
  EXPECT_THAT(ReadCalibration(path, 2).error().message,
              HasSubstr(":3: P2: expected the 12 finite numbers fx 0 cx a 0 fy cy b 0 0 1 c with fx"));
  folder_.Write("calib.txt", "P2: 7.07e+02 0 6e+02 4.6e+01 0 7.07e+02 1.8e+02 0.1 0 0 1 0.006\n");
  EXPECT_EQ(ReadCalibration(path, 2)->pinhole.fx, 707) << "alone in its file";
}

TEST_F(CalibrationTest, NamesTheLineOfABadValue) {
  EXPECT_EQ(FailureOf(OwnWith("fx", "fx: -585")), ":4: fx: expected a finite number above 0, found '-585'");
  EXPECT_EQ(FailureOf(OwnWith("fy", "fy: .nan")), ":5: fy: expected a finite number above 0, found '.nan'");
  EXPECT_EQ(FailureOf(OwnWith("fx", "fx: 0")), ":4: fx: expected a finite number above 0, found '0'");
  EXPECT_EQ(FailureOf(OwnWith("cx", "cx: .inf")), ":6: cx: expected a finite number, found '.inf'");
  EXPECT_EQ(FailureOf(OwnWith("width", "width: 640.5")),
            ":2: width: expected a whole number of pixels from 1 to 65535, found '640.5'");
  EXPECT_EQ(FailureOf(OwnWith("model", "model: mirror")), ":1: model: expected pinhole or fisheye, found 'mirror'");
  EXPECT_EQ(FailureOf(OwnWith("distortion", "distortion: [1, 2, 3]")),
            ":8: distortion: expected a list of 0 or 4 or 5 finite numbers, found '1, 2, 3'");
  EXPECT_EQ(FailureOf(OwnWith("fps", "fps: -1")), ":9: fps: expected a finite number above 0, found '-1'");
  EXPECT_THAT(FailureOf(OwnWith("cx", "cx: 5000")), HasSubstr("cx")) << "outside of the image";
}

TEST_F(CalibrationTest, NamesMissingUnknownAndRepeatedKeys) {
  EXPECT_EQ(FailureOf(OwnWith("fy", "")), ": key 'fy' is missing; expected a finite number above 0");
  EXPECT_EQ(FailureOf(OwnWith("height", "heigth: 480")), ":3: unknown key 'heigth'; did you mean 'height'?");
  EXPECT_EQ(FailureOf(OwnWith("fy", "fx: 585")), ":5: key 'fx' is given twice, first on line 4");
}

TEST_F(CalibrationTest, OtherFormsAreCheckedAsStrictly) {
  EXPECT_THAT(FailureOf(Replaced(kEuroc, "radial-tangential", "omni")),
              HasSubstr(":15: distortion_model: expected radial-tangential or equidistant"));
  EXPECT_THAT(FailureOf(Replaced(kEuroc, "458.654", "nan")),
              HasSubstr("intrinsics: expected a list of 4 finite numbers"));
  EXPECT_THAT(FailureOf(Replaced(kEuroc, "458.654", "-458.654")),
              HasSubstr("intrinsics: expected [fx, fy, cx, cy] with fx and fy above 0"));
  EXPECT_THAT(FailureOf(Replaced(kEuroc, "[752, 480]", "[752.5, 480]")),
              HasSubstr("resolution: expected [width, height]"));
  EXPECT_THAT(FailureOf(Replaced(kRos, "plumb_bob", "rational_polynomial")),
              HasSubstr("distortion_model: expected plumb_bob or equidistant"));
  EXPECT_THAT(FailureOf(Replaced(kRos, "430.2", "-430.2")), HasSubstr("camera_matrix.data: expected [fx, 0, cx"));
  EXPECT_THAT(FailureOf(Replaced(kOrbSlam2, "517.306408", "-1")),
              HasSubstr(":4: Camera.fx: expected a finite number above 0"));
  EXPECT_THAT(FailureOf(Replaced(kOrbSlam2, "Camera.cy", "Camera.cz")), HasSubstr("key 'Camera.cy' is missing"));
  EXPECT_THAT(FailureOf(Replaced(kOrbSlam3, "KannalaBrandt8", "Omni")),
              HasSubstr("Camera.type: expected PinHole, Rectified or KannalaBrandt8"));
  EXPECT_THAT(FailureOf(Replaced(kKitti, "7.188560e+02", "-7.188560e+02")),
              HasSubstr(":1: P0: expected the 12 finite numbers"));
  EXPECT_THAT(FailureOf(Replaced(kKitti, "1.0 0.0\n", "1.0\n")), HasSubstr(":1: P0: expected the 12 finite numbers"));
  EXPECT_THAT(FailureOf(Replaced(kKitti, "P1", "P0")), HasSubstr(":2: P0 is given twice, first on line 1"));
  EXPECT_THAT(FailureOf(Replaced(kKitti, "P0", "P3")), HasSubstr("row 'P0:' is missing"));
  EXPECT_THAT(FailureOf(Replaced(Replaced(kKitti, "P0", "P3"), "P1", "P0")),
              HasSubstr(":2: P0: expected the 12 finite numbers fx 0 cx 0 0 fy cy 0 0 0 1 0 with fx"))
      << "camera 0 has no camera to lie beside";
}

TEST_F(CalibrationTest, WhatIsNoCalibrationSaysWhatWasExpected) {
  EXPECT_THAT(FailureOf("colour: red\n"), HasSubstr("not a camera calibration: expected the keys of Portolan"));
  EXPECT_THAT(FailureOf(""), HasSubstr("not a camera calibration"));
  EXPECT_THAT(FailureOf("fx: [1, 2\n"), HasSubstr("not valid YAML"));
  EXPECT_THAT(ReadCalibration("/nowhere/camera.yaml").error().message, HasSubstr("can't be opened"));
}

TEST_F(CalibrationTest, ReadsTheSharedSequences) {
  const std::string data = SharedDataFolder();
  if (data.empty()) GTEST_SKIP() << "no shared/data beside the repository and PORTOLAN_DATA is not set";
  for (const char* name : {"kitchen/camera.yaml", "halls/camera.yaml", "office_walk/camera.yaml", "kitti_00/calib.txt",
                           "town_lap/calib.txt"}) {
    const auto camera = ReadCalibration(data + "/" + name);
    EXPECT_TRUE(camera) << name << ": " << (camera ? "" : camera.error().message);
  }
}

}  // namespace
}  // namespace portolan
