#pragma once

#include <sqlite3.h>

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "base/result.h"

namespace portolan {

/// A prepared statement: bind its values, step, read its columns. A failure shows in Step().
class SqlStatement {
 public:
  SqlStatement(sqlite3* database, sqlite3_stmt* statement)
      : database_(database), statement_(statement, &sqlite3_finalize) {}

  SqlStatement& Bind(int index, uint64_t value);
  /// The bytes must stay until the step is done.
  SqlStatement& Bind(int index, std::string_view bytes);
  /// @return whether there is a row.
  Result<bool> Step();
  /// Steps once, for a statement that has no rows; ready to be bound and run again.
  Status Run();

  uint64_t Integer(int column) const { return static_cast<uint64_t>(sqlite3_column_int64(statement_.get(), column)); }
  /// Until the next step.
  std::string_view Blob(int column) const;

 private:
  sqlite3* database_;
  std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)> statement_;
};

/// An SQLite file. Errors carry SQLite's words; whoever uses it adds the path.
class SqlDatabase {
 public:
  /// Opens or makes the file.
  static Result<SqlDatabase> Open(const std::string& path);

  Status Execute(const std::string& sql);
  Result<SqlStatement> Prepare(const std::string& sql);
  /// The first value of a query's first row, as an integer; 0 if none.
  Result<uint64_t> QueryInteger(const std::string& sql);
  /// Calls read(row) for each row of a query.
  Status ForEachRow(const std::string& sql, const std::function<void(const SqlStatement& row)>& read);

 private:
  explicit SqlDatabase(sqlite3* handle) : handle_(handle, &sqlite3_close_v2) {}
  std::unique_ptr<sqlite3, decltype(&sqlite3_close_v2)> handle_;
};

}  // namespace portolan
