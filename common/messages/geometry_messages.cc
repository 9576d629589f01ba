#include "messages/geometry_messages.h"

#include <cmath>
#include <string>

#include "messages/limits.h"

namespace portolan {
namespace {

std::array<double, 4> QuaternionToArray(const Eigen::Quaterniond& q) {
  return {q.x(), q.y(), q.z(), q.w()};
}
std::array<double, 3> VectorToArray(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

Eigen::Quaterniond QuaternionFromArray(const double* xyzw) {
  return Eigen::Quaterniond(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
}
Eigen::Vector3d VectorFromArray(const double* xyz) {
  return Eigen::Vector3d(xyz[0], xyz[1], xyz[2]);
}

void CheckPose(const char* field, const double* quaternion, const double* translation, MessageCheck* check) {
  check->UnitQuaternion(field, quaternion);
  for (int i = 0; i < 3; ++i) check->Finite(field, translation[i]);
}

void CheckScale(const char* field, double scale, MessageCheck* check) {
  check->Require(std::isfinite(scale) && scale > 0,
                 std::string(field) + ": scale " + std::to_string(scale) + ", positive expected");
}

}  // namespace

wire_v1::Rigid3 ToWire(const Rigid3d& rigid) {
  wire_v1::Rigid3 wire;
  wire.rotation(QuaternionToArray(rigid.rotation));
  wire.translation(VectorToArray(rigid.translation));
  return wire;
}

Rigid3d FromWire(const wire_v1::Rigid3& wire) {
  return Rigid3d(QuaternionFromArray(wire.rotation().data()), VectorFromArray(wire.translation().data()));
}

void CheckRigid3(const char* field, const wire_v1::Rigid3& wire, MessageCheck* check) {
  CheckPose(field, wire.rotation().data(), wire.translation().data(), check);
}

wire_v1::Sim3 ToWire(const Sim3d& similarity) {
  wire_v1::Sim3 wire;
  wire.scale(similarity.scale);
  wire.rotation(QuaternionToArray(similarity.rotation));
  wire.translation(VectorToArray(similarity.translation));
  return wire;
}

Sim3d FromWire(const wire_v1::Sim3& wire) {
  return Sim3d(wire.scale(), QuaternionFromArray(wire.rotation().data()), VectorFromArray(wire.translation().data()));
}

void CheckSim3(const char* field, const wire_v1::Sim3& wire, MessageCheck* check) {
  CheckScale(field, wire.scale(), check);
  CheckPose(field, wire.rotation().data(), wire.translation().data(), check);
}

wire_v1::PinholeCamera ToWire(const PinholeCamera& camera) {
  wire_v1::PinholeCamera wire;
  wire.fx(camera.fx);
  wire.fy(camera.fy);
  wire.cx(camera.cx);
  wire.cy(camera.cy);
  wire.width(static_cast<uint32_t>(camera.width));
  wire.height(static_cast<uint32_t>(camera.height));
  return wire;
}

PinholeCamera FromWire(const wire_v1::PinholeCamera& wire) {
  return PinholeCamera{
      wire.fx(), wire.fy(), wire.cx(), wire.cy(), static_cast<int>(wire.width()), static_cast<int>(wire.height())};
}

void CheckCamera(const wire_v1::PinholeCamera& wire, MessageCheck* check) {
  check->Finite("camera.cx", wire.cx());
  check->Finite("camera.cy", wire.cy());
  check->Require(std::isfinite(wire.fx()) && wire.fx() > 0, "camera.fx is not positive");
  check->Require(std::isfinite(wire.fy()) && wire.fy() > 0, "camera.fy is not positive");
  check->Require(wire.width() > 0 && wire.height() > 0, "camera has no size");
  check->AtMost("camera.width", wire.width(), kMaxImageSide);
  check->AtMost("camera.height", wire.height(), kMaxImageSide);
}

wire_v1::RadialResidual ToWire(const RadialResidual& residual) {
  wire_v1::RadialResidual wire;
  wire.k1(residual.k1);
  wire.k2(residual.k2);
  return wire;
}

RadialResidual FromWire(const wire_v1::RadialResidual& wire) {
  return {wire.k1(), wire.k2()};
}

void CheckResidual(const wire_v1::RadialResidual& wire, MessageCheck* check) {
  for (const auto& [field, value] : {std::pair("residual.k1", wire.k1()), std::pair("residual.k2", wire.k2())}) {
    check->Require(std::abs(value) <= kMaxRadialResidual,
                   std::string(field) + " is " + std::to_string(value) + ", expected at most 1 either way");
  }
}

wire_v1::CameraResidual ToWire(const CameraResidual& known) {
  wire_v1::CameraResidual wire;
  wire.camera(ToWire(known.camera));
  wire.residual(ToWire(known.residual));
  return wire;
}

void AppendRigid3(const Rigid3d& rigid, std::vector<double>* values) {
  const auto rotation = QuaternionToArray(rigid.rotation);
  const auto translation = VectorToArray(rigid.translation);
  values->insert(values->end(), rotation.begin(), rotation.end());
  values->insert(values->end(), translation.begin(), translation.end());
}

Rigid3d Rigid3FromArray(const double* values) {
  return Rigid3d(QuaternionFromArray(values), VectorFromArray(values + 4));
}

void CheckPoseArray(const char* field, const std::vector<double>& values, bool scale_first, MessageCheck* check) {
  const size_t stride = kRigid3Doubles + (scale_first ? 1 : 0);
  check->AllFinite(field, values);
  for (size_t i = 0; check->ok() && i + stride <= values.size(); i += stride) {
    if (scale_first) CheckScale(field, values[i], check);
    check->UnitQuaternion(field, &values[i + (scale_first ? 1 : 0)]);
  }
}

void AppendPoint(const Eigen::Vector3f& point, std::vector<float>* values) {
  values->insert(values->end(), {point.x(), point.y(), point.z()});
}

}  // namespace portolan
