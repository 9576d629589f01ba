#include "atlas/sqlite.h"

#include <cstring>
#include <utility>

namespace portolan {
namespace {

Error LastError(sqlite3* database) {
  std::string message = sqlite3_errmsg(database);
  if (const int system = sqlite3_system_errno(database); system != 0)
    message += std::string(" (") + std::strerror(system) + ")";
  return Error{message};
}

}  // namespace

SqlStatement& SqlStatement::Bind(int index, uint64_t value) {
  const int code = sqlite3_bind_int64(statement_.get(), index, static_cast<sqlite3_int64>(value));
  PORTOLAN_CHECK(code == SQLITE_OK) << sqlite3_errstr(code);
  return *this;
}

SqlStatement& SqlStatement::Bind(int index, std::string_view bytes) {
  const int code = sqlite3_bind_blob64(statement_.get(), index, bytes.data(), bytes.size(), SQLITE_STATIC);
  PORTOLAN_CHECK(code == SQLITE_OK) << sqlite3_errstr(code);
  return *this;
}

Result<bool> SqlStatement::Step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return LastError(database_);
}

Status SqlStatement::Run() {
  const Result<bool> row = Step();
  if (!row) return row.error();
  sqlite3_reset(statement_.get());
  return Ok{};
}

std::string_view SqlStatement::Blob(int column) const {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement_.get(), column));
  return bytes == nullptr
             ? std::string_view()
             : std::string_view(bytes, static_cast<size_t>(sqlite3_column_bytes(statement_.get(), column)));
}

Result<SqlDatabase> SqlDatabase::Open(const std::string& path) {
  sqlite3* handle = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &handle, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  PORTOLAN_CHECK(handle != nullptr) << "out of memory";
  SqlDatabase database(handle);
  if (code != SQLITE_OK) return LastError(handle);
  return database;
}

Status SqlDatabase::Execute(const std::string& sql) {
  if (sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) return LastError(handle_.get());
  return Ok{};
}

Result<SqlStatement> SqlDatabase::Prepare(const std::string& sql) {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(handle_.get(), sql.c_str(), -1, &statement, nullptr) != SQLITE_OK)
    return LastError(handle_.get());
  return SqlStatement(handle_.get(), statement);
}

Result<uint64_t> SqlDatabase::QueryInteger(const std::string& sql) {
  Result<SqlStatement> query = Prepare(sql);
  if (!query) return query.error();
  const Result<bool> row = query->Step();
  if (!row) return row.error();
  return *row ? query->Integer(0) : 0;
}

Status SqlDatabase::ForEachRow(const std::string& sql, const std::function<void(const SqlStatement& row)>& read) {
  Result<SqlStatement> query = Prepare(sql);
  if (!query) return query.error();
  for (;;) {
    const Result<bool> row = query->Step();
    if (!row) return row.error();
    if (!*row) return Ok{};
    read(*query);
  }
}

}  // namespace portolan
