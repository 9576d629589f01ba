#include "atlas/graph_tables.h"

#include <optional>

#include "base/hash.h"
#include "map/byte_stream.h"

namespace portolan {
namespace {

uint64_t HashOf(MapId map, MapId other, std::string_view transform) {
  Hasher hasher;
  hasher.Add(map.value);
  hasher.Add(other.value);
  hasher.AddBytes(transform.data(), transform.size());
  return hasher.Value();
}

/// How it was found, scale, rotation (x, y, z, w) and translation as doubles, and a hash over them and the two maps.
template <class T>
std::string TransformBlob(const T& entry, uint8_t origin) {
  ByteWriter writer;
  writer.Fixed(origin);
  writer.Fixed(entry.map_from_other.scale);
  writer.FixedArray(entry.map_from_other.rotation.coeffs().data(), 4);
  writer.FixedArray(entry.map_from_other.translation.data(), 3);
  writer.Fixed(HashOf(entry.map, entry.other, writer.bytes()));
  return writer.Take();
}

/// Reads it for the two maps that `entry` names. @return the origin, or none when it is damaged.
template <class T>
std::optional<uint8_t> ReadTransformBlob(std::string_view blob, T* entry) {
  ByteReader reader(blob);
  const auto origin = reader.Fixed<uint8_t>();
  entry->map_from_other.scale = reader.Fixed<double>();
  reader.FixedArray(entry->map_from_other.rotation.coeffs().data(), 4);
  reader.FixedArray(entry->map_from_other.translation.data(), 3);
  const auto hash = reader.Fixed<uint64_t>();
  if (!reader.AtEnd() || hash != HashOf(entry->map, entry->other, blob.substr(0, blob.size() - sizeof hash)))
    return std::nullopt;
  return origin;
}

}  // namespace

Status MakeGraphTables(SqlDatabase* database) {
  return database->Execute(
      "CREATE TABLE graph_map(id INTEGER PRIMARY KEY);"
      "CREATE TABLE link(map INTEGER NOT NULL, other INTEGER NOT NULL, transform BLOB NOT NULL, PRIMARY KEY(map, "
      "other));"
      "CREATE TABLE fused(map INTEGER NOT NULL, other INTEGER PRIMARY KEY, transform BLOB NOT NULL);"
      "CREATE TABLE activity(map INTEGER NOT NULL, other INTEGER NOT NULL, count INTEGER NOT NULL, PRIMARY KEY(map, "
      "other));");
}

Status WriteGraph(const MapGraph::State& graph, SqlDatabase* database) {
  for (const char* table : {"graph_map", "link", "fused", "activity"}) {
    if (Status cleared = database->Execute(std::string("DELETE FROM ") + table); !cleared) return cleared;
  }
  Result<SqlStatement> map = database->Prepare("INSERT OR REPLACE INTO graph_map VALUES (?1)");
  if (!map) return map.error();
  for (const MapId id : graph.maps) {
    if (Status inserted = map->Bind(1, id.value).Run(); !inserted) return inserted;
  }
  Result<SqlStatement> link = database->Prepare("INSERT OR REPLACE INTO link VALUES (?1, ?2, ?3)");
  if (!link) return link.error();
  for (const MapGraph::Link& entry : graph.links) {
    const std::string blob = TransformBlob(entry, static_cast<uint8_t>(entry.origin));
    link->Bind(1, entry.map.value).Bind(2, entry.other.value).Bind(3, std::string_view(blob));
    if (Status inserted = link->Run(); !inserted) return inserted;
  }
  Result<SqlStatement> fused = database->Prepare("INSERT OR REPLACE INTO fused VALUES (?1, ?2, ?3)");
  if (!fused) return fused.error();
  for (const MapGraph::Fused& entry : graph.fused) {
    const std::string blob = TransformBlob(entry, 0);
    fused->Bind(1, entry.map.value).Bind(2, entry.other.value).Bind(3, std::string_view(blob));
    if (Status inserted = fused->Run(); !inserted) return inserted;
  }
  Result<SqlStatement> activity = database->Prepare("INSERT OR REPLACE INTO activity VALUES (?1, ?2, ?3)");
  if (!activity) return activity.error();
  for (const MapGraph::Activity& entry : graph.activities) {
    activity->Bind(1, entry.map.value).Bind(2, entry.other.value).Bind(3, entry.count);
    if (Status inserted = activity->Run(); !inserted) return inserted;
  }
  return Ok{};
}

Status RemoveFromGraph(MapId id, SqlDatabase* database) {
  for (const char* sql : {"DELETE FROM graph_map WHERE id = ?1", "DELETE FROM link WHERE map = ?1 OR other = ?1",
                          "DELETE FROM fused WHERE map = ?1", "DELETE FROM activity WHERE map = ?1 OR other = ?1"}) {
    Result<SqlStatement> remove = database->Prepare(sql);
    if (!remove) return remove.error();
    if (Status removed = remove->Bind(1, id.value).Run(); !removed) return removed;
  }
  return Ok{};
}

Result<MapGraph::State> ReadGraph(SqlDatabase* database, std::vector<std::string>* problems) {
  MapGraph::State graph;
  const auto note_damage = [&](const std::string& what, MapId map, MapId other) {
    const std::string name = "the " + what + " of map " + ToString(map) + " and map " + ToString(other);
    problems->push_back(name + " is left out: damaged");
  };
  Status read = database->ForEachRow("SELECT id FROM graph_map ORDER BY id",
                                     [&](const SqlStatement& row) { graph.maps.emplace_back(row.Integer(0)); });
  if (!read) return read.error();
  read =
      database->ForEachRow("SELECT map, other, transform FROM link ORDER BY map, other", [&](const SqlStatement& row) {
        MapGraph::Link link;
        link.map = MapId(row.Integer(0));
        link.other = MapId(row.Integer(1));
        const std::optional<uint8_t> origin = ReadTransformBlob(row.Blob(2), &link);
        if (!origin) return note_damage("link", link.map, link.other);
        link.origin = static_cast<MapGraph::Origin>(*origin);
        graph.links.push_back(link);
      });
  if (!read) return read.error();
  read = database->ForEachRow("SELECT map, other, transform FROM fused ORDER BY other", [&](const SqlStatement& row) {
    MapGraph::Fused fused{MapId(row.Integer(0)), MapId(row.Integer(1)), Sim3d()};
    if (!ReadTransformBlob(row.Blob(2), &fused)) return note_damage("fusion", fused.map, fused.other);
    graph.fused.push_back(fused);
  });
  if (!read) return read.error();
  read =
      database->ForEachRow("SELECT map, other, count FROM activity ORDER BY map, other", [&](const SqlStatement& row) {
        graph.activities.push_back({MapId(row.Integer(0)), MapId(row.Integer(1)), row.Integer(2)});
      });
  if (!read) return read.error();
  return graph;
}

}  // namespace portolan
