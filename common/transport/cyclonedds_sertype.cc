#include "transport/cyclonedds_sertype.h"

#include <dds/ddsi/ddsi_keyhash.h>
#include <dds/ddsi/q_radmin.h>
#include <dds/ddsrt/md5.h>
#include <dds/ddsrt/mh3.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <new>

#include "messages/wire_codec.h"

// The library calls these functions from its C code: they must not throw, and return null or false when memory runs
// out.

namespace portolan {
namespace {

struct Sertype {
  ddsi_sertype base{};  // first: the library knows this part
  bool keyed = false;
};

struct Serdata {
  ddsi_serdata base{};  // first: the library knows this part
  SampleBytes bytes;    // capacity rounded up to 4: the library may read the padding
  SampleKey key;
};

Serdata* Own(ddsi_serdata* data) {
  return reinterpret_cast<Serdata*>(data);
}
const Serdata* Own(const ddsi_serdata* data) {
  return reinterpret_cast<const Serdata*>(data);
}
bool IsKeyed(const ddsi_sertype* type) {
  return reinterpret_cast<const Sertype*>(type)->keyed;
}

size_t PaddedSize(size_t size) {
  return (size + 3) & ~size_t{3};
}

ddsi_serdata* Finish(std::unique_ptr<Serdata> data, const ddsi_sertype* type) {
  data->base.hash = ddsrt_mh3(data->key.bytes, SampleKey::kBytes, 0) ^ type->serdata_basehash;
  return &data.release()->base;
}

/// Takes over serialised bytes. Unkeyed samples all have the key of zeros.
ddsi_serdata* FromBytes(const ddsi_sertype* type, ddsi_serdata_kind kind, SampleBytes bytes) try {
  auto data = std::make_unique<Serdata>();
  ddsi_serdata_init(&data->base, type, kind);
  const size_t size = bytes.size();
  bytes.resize(PaddedSize(size));
  bytes.resize(size);  // the padding stays within the capacity, as zeros
  data->bytes = std::move(bytes);
  if (IsKeyed(type)) data->key = KeyOfSample(data->bytes.data(), size);
  return Finish(std::move(data), type);
} catch (const std::bad_alloc&) {
  return nullptr;
}

/// A sample that is only a key: CDR_BE header and the key, big-endian.
ddsi_serdata* FromKey(const ddsi_sertype* type, const SampleKey& key) try {
  SampleBytes bytes;
  if (IsKeyed(type)) {
    bytes.assign(kEncapsulationBytes, 0);
    bytes.insert(bytes.end(), key.bytes, key.bytes + SampleKey::kBytes);
  }
  return FromBytes(type, SDK_KEY, std::move(bytes));
} catch (const std::bad_alloc&) {
  return nullptr;
}

bool EqualKey(const ddsi_serdata* a, const ddsi_serdata* b) {
  return std::memcmp(Own(a)->key.bytes, Own(b)->key.bytes, SampleKey::kBytes) == 0;
}

uint32_t GetSize(const ddsi_serdata* data) {
  return static_cast<uint32_t>(Own(data)->bytes.size());
}

/// From received fragments, which may overlap.
ddsi_serdata* FromFragments(const ddsi_sertype* type, ddsi_serdata_kind kind, const nn_rdata* fragment,
                            size_t size) try {
  SampleBytes bytes(size);
  size_t end = 0;
  for (; fragment != nullptr; fragment = fragment->nextfrag) {
    if (fragment->maxp1 <= end || fragment->min > end || fragment->maxp1 > size) continue;
    const uint8_t* payload = NN_RMSG_PAYLOADOFF(fragment->rmsg, NN_RDATA_PAYLOAD_OFF(fragment));
    std::memcpy(bytes.data() + end, payload + (end - fragment->min), fragment->maxp1 - end);
    end = fragment->maxp1;
  }
  return FromBytes(type, kind, std::move(bytes));
} catch (const std::bad_alloc&) {
  return nullptr;
}

ddsi_serdata* FromVectors(const ddsi_sertype* type, ddsi_serdata_kind kind, ddsrt_msg_iovlen_t count,
                          const ddsrt_iovec_t* vectors, size_t size) try {
  SampleBytes bytes;
  bytes.reserve(PaddedSize(size));
  for (ddsrt_msg_iovlen_t i = 0; i < count && bytes.size() < size; ++i) {
    const auto* begin = static_cast<const uint8_t*>(vectors[i].iov_base);
    bytes.insert(bytes.end(), begin, begin + std::min<size_t>(vectors[i].iov_len, size - bytes.size()));
  }
  return FromBytes(type, kind, std::move(bytes));
} catch (const std::bad_alloc&) {
  return nullptr;
}

ddsi_serdata* FromKeyHash(const ddsi_sertype* type, const ddsi_keyhash* hash) {
  SampleKey key;
  if (IsKeyed(type)) std::copy_n(hash->value, SampleKey::kBytes, key.bytes);
  return FromKey(type, key);
}

/// For dds_write and dds_dispose, with SampleBytes as the sample.
ddsi_serdata* FromSample(const ddsi_sertype* type, ddsi_serdata_kind kind, const void* sample) try {
  const SampleBytes& bytes = *static_cast<const SampleBytes*>(sample);
  return kind == SDK_KEY ? FromKey(type, KeyOfSample(bytes.data(), bytes.size())) : FromBytes(type, kind, bytes);
} catch (const std::bad_alloc&) {
  return nullptr;
}

void ToBytes(const ddsi_serdata* data, size_t offset, size_t size, void* buffer) {
  std::memcpy(buffer, Own(data)->bytes.data() + offset, size);
}

ddsi_serdata* ToBytesRef(const ddsi_serdata* data, size_t offset, size_t size, ddsrt_iovec_t* reference) {
  reference->iov_base = const_cast<uint8_t*>(Own(data)->bytes.data() + offset);
  reference->iov_len = static_cast<ddsrt_iov_len_t>(size);
  return ddsi_serdata_ref(data);
}

void ToBytesUnref(ddsi_serdata* data, const ddsrt_iovec_t* /*reference*/) {
  ddsi_serdata_unref(data);
}

bool ToSample(const ddsi_serdata* data, void* sample, void** /*buffer*/, void* /*limit*/) try {
  *static_cast<SampleBytes*>(sample) = Own(data)->bytes;
  return true;
} catch (const std::bad_alloc&) {
  return false;
}

/// The key alone, as the table of instances keeps it.
ddsi_serdata* ToUntyped(const ddsi_serdata* data) {
  ddsi_serdata* key = FromKey(data->type, Own(data)->key);
  if (key == nullptr) return nullptr;
  key->type = nullptr;
  key->hash = data->hash;
  return key;
}

bool UntypedToSample(const ddsi_sertype* /*type*/, const ddsi_serdata* /*data*/, void* /*sample*/, void** /*buffer*/,
                     void* /*limit*/) {
  return true;  // a sample without data: its bytes stay empty
}

void Free(ddsi_serdata* data) {
  delete Own(data);
}

size_t Print(const ddsi_sertype* /*type*/, const ddsi_serdata* /*data*/, char* buffer, size_t size) {
  if (size > 0) buffer[0] = '\0';
  return 0;
}

void GetKeyHash(const ddsi_serdata* data, ddsi_keyhash* hash, bool force_md5) {
  std::memset(hash->value, 0, sizeof hash->value);
  if (!force_md5) {
    std::copy_n(Own(data)->key.bytes, SampleKey::kBytes, hash->value);
    return;
  }
  ddsrt_md5_state_t md5;
  ddsrt_md5_init(&md5);
  ddsrt_md5_append(&md5, Own(data)->key.bytes, SampleKey::kBytes);
  ddsrt_md5_finish(&md5, hash->value);
}

ddsi_serdata_ops MakeSerdataOps() {
  ddsi_serdata_ops ops{};
  ops.eqkey = EqualKey;
  ops.get_size = GetSize;
  ops.from_ser = FromFragments;
  ops.from_ser_iov = FromVectors;
  ops.from_keyhash = FromKeyHash;
  ops.from_sample = FromSample;
  ops.to_ser = ToBytes;
  ops.to_ser_ref = ToBytesRef;
  ops.to_ser_unref = ToBytesUnref;
  ops.to_sample = ToSample;
  ops.to_untyped = ToUntyped;
  ops.untyped_to_sample = UntypedToSample;
  ops.free = Free;
  ops.print = Print;
  ops.get_keyhash = GetKeyHash;
  return ops;
}

void FreeType(ddsi_sertype* type) {
  ddsi_sertype_fini(type);
  delete reinterpret_cast<Sertype*>(type);
}

ddsi_sertype_ops MakeSertypeOps() {
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = FreeType;
  ops.zero_samples = [](const ddsi_sertype*, void*, size_t) {};
  ops.realloc_samples = [](void**, const ddsi_sertype*, void*, size_t, size_t) {};
  ops.free_samples = [](const ddsi_sertype*, void**, size_t, dds_free_op_t) {};
  ops.equal = [](const ddsi_sertype*, const ddsi_sertype*) {
    return true;
  };  // names and keys are compared by the library
  ops.hash = [](const ddsi_sertype*) -> uint32_t { return 0; };
  return ops;
}

}  // namespace

ddsi_sertype* MakeCycloneDdsType(const std::string& name, bool keyed) {
  static const ddsi_serdata_ops serdata_ops = MakeSerdataOps();
  static const ddsi_sertype_ops sertype_ops = MakeSertypeOps();
  auto* type = new Sertype;
  type->keyed = keyed;
  ddsi_sertype_init(&type->base, name.c_str(), &sertype_ops, &serdata_ops, !keyed);
  type->base.allowed_data_representation = DDS_DATA_REPRESENTATION_FLAG_XCDR1;
  return &type->base;
}

ddsi_serdata* MakeCycloneDdsSample(const ddsi_sertype* type, SampleBytes bytes) {
  return FromBytes(type, SDK_DATA, std::move(bytes));
}

const SampleBytes& BytesOfCycloneDdsSample(const ddsi_serdata* sample) {
  return Own(sample)->bytes;
}

}  // namespace portolan
