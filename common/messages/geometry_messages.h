#pragma once

#include <portolan_idl/geometry.h>

#include <Eigen/Core>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "messages/message_check.h"

namespace portolan {

// Poses and cameras on the wire. FromWire functions here expect checked values; the Check functions check them.

wire_v1::Rigid3 ToWire(const Rigid3d& rigid);
Rigid3d FromWire(const wire_v1::Rigid3& wire);
void CheckRigid3(const char* field, const wire_v1::Rigid3& wire, MessageCheck* check);

wire_v1::Sim3 ToWire(const Sim3d& similarity);
Sim3d FromWire(const wire_v1::Sim3& wire);
void CheckSim3(const char* field, const wire_v1::Sim3& wire, MessageCheck* check);

wire_v1::PinholeCamera ToWire(const PinholeCamera& camera);
PinholeCamera FromWire(const wire_v1::PinholeCamera& wire);
/// Finite, positive focal lengths, sides from 1 to kMaxImageSide.
void CheckCamera(const wire_v1::PinholeCamera& wire, MessageCheck* check);

wire_v1::RadialResidual ToWire(const RadialResidual& residual);
RadialResidual FromWire(const wire_v1::RadialResidual& wire);
/// Both coefficients finite and at most kMaxRadialResidual either way.
void CheckResidual(const wire_v1::RadialResidual& wire, MessageCheck* check);
wire_v1::CameraResidual ToWire(const CameraResidual& known);

/// A pose in an array of doubles: quaternion x, y, z, w, then translation.
constexpr size_t kRigid3Doubles = 7;
void AppendRigid3(const Rigid3d& rigid, std::vector<double>* values);
Rigid3d Rigid3FromArray(const double* values);
/// Finite and unit quaternions throughout. @param scale_first 8 doubles an element, the first a positive scale; else 7.
void CheckPoseArray(const char* field, const std::vector<double>& values, bool scale_first, MessageCheck* check);

/// Points in an array of floats, three each.
void AppendPoint(const Eigen::Vector3f& point, std::vector<float>* values);

}  // namespace portolan
