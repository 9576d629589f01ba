#include "transport/credentials.h"

#include <fnmatch.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/pkcs7.h>
#include <openssl/x509.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <utility>
#include <vector>

namespace portolan {
namespace {

template <class T, void (*Free)(T*)>
struct Deleter {
  void operator()(T* object) const { Free(object); }
};
void FreeBio(BIO* bio) {
  BIO_free_all(bio);
}
void FreeStack(STACK_OF(X509) * stack) {
  sk_X509_free(stack);
}
using Bio = std::unique_ptr<BIO, Deleter<BIO, FreeBio>>;
using Certificate = std::unique_ptr<X509, Deleter<X509, X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Deleter<EVP_PKEY, EVP_PKEY_free>>;
using Signed = std::unique_ptr<PKCS7, Deleter<PKCS7, PKCS7_free>>;
using CertificateStack = std::unique_ptr<STACK_OF(X509), Deleter<STACK_OF(X509), FreeStack>>;

Error Complain(const std::string& file, const std::string& what) {
  ERR_clear_error();
  return Error{"dds.security: " + file + ": " + what};
}

std::string TimeText(int64_t time_s) {
  const std::time_t time = static_cast<std::time_t>(time_s);
  std::tm utc{};
  gmtime_r(&time, &utc);
  char text[32] = "";
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", &utc);
  return text;
}

Status CheckPeriod(const std::string& file, const std::string& what, int64_t begins_s, int64_t ends_s, int64_t now_s) {
  if (now_s < begins_s) {
    return Complain(file,
                    what + " holds from " + TimeText(begins_s) + " on; this machine's clock says " + TimeText(now_s));
  }
  if (now_s > ends_s) return Complain(file, what + " expired on " + TimeText(ends_s) + "; make_keys.py makes new ones");
  return Ok{};
}

Result<Bio> OpenFile(const std::string& file) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  if (!stream || std::filesystem::is_directory(file)) {
    return Complain(
        file, std::string(stream ? "is a folder" : std::strerror(errno)) + "; a file that make_keys.py made expected");
  }
  text << stream.rdbuf();
  const std::string content = text.str();
  Bio bio(BIO_new(BIO_s_mem()));
  BIO_write(bio.get(), content.data(), static_cast<int>(content.size()));
  return Result<Bio>(std::move(bio));
}

Result<Certificate> ReadCertificate(const std::string& file) {
  const Result<Bio> bio = OpenFile(file);
  if (!bio) return bio.error();
  Certificate certificate(PEM_read_bio_X509(bio->get(), nullptr, nullptr, nullptr));
  if (!certificate) return Complain(file, "no certificate in PEM form");
  return Result<Certificate>(std::move(certificate));
}

int64_t SecondsOf(const ASN1_TIME* time) {
  std::tm utc{};
  ASN1_TIME_to_tm(time, &utc);
  return timegm(&utc);
}

Status CheckPeriod(const std::string& file, const X509* certificate, int64_t now_s) {
  return CheckPeriod(file, "the certificate", SecondsOf(X509_get0_notBefore(certificate)),
                     SecondsOf(X509_get0_notAfter(certificate)), now_s);
}

/// Answers OpenSSL's question for a password, which would wait for a terminal.
int NoPassword(char* /*buffer*/, int /*size*/, int /*write*/, void* asked) {
  *static_cast<bool*>(asked) = true;
  return -1;
}

Status CheckKey(const std::string& file, const std::string& certificate_file, X509* certificate) {
  const Result<Bio> bio = OpenFile(file);
  if (!bio) return bio.error();
  struct stat info {};
  if (stat(file.c_str(), &info) == 0 && (info.st_mode & S_IRWXO) != 0)
    return Complain(file, "everybody on this machine may use this private key; chmod o= it");
  bool is_locked = false;
  const Key key(PEM_read_bio_PrivateKey(bio->get(), nullptr, NoPassword, &is_locked));
  if (!key) return Complain(file, is_locked ? "has a password; one without expected" : "no private key in PEM form");
  if (X509_check_private_key(certificate, key.get()) != 1)
    return Complain(file, "is not the key of " + certificate_file);
  return Ok{};
}

/// What a document says, if it is signed by the permissions CA.
Result<std::string> ReadSigned(const std::string& file, const std::string& ca_file, X509* ca) {
  const Result<Bio> bio = OpenFile(file);
  if (!bio) return bio.error();
  BIO* content = nullptr;
  const Signed document(SMIME_read_PKCS7(bio->get(), &content));
  const Bio content_owner(content);
  if (!document) return Complain(file, "no signed document (S/MIME)");
  const CertificateStack signers(sk_X509_new_null());
  sk_X509_push(signers.get(), ca);
  const Bio text(BIO_new(BIO_s_mem()));
  // The CA itself has to be the signer: there is no chain to be followed, only its signature to be checked.
  if (PKCS7_verify(document.get(), signers.get(), nullptr, content, text.get(),
                   PKCS7_TEXT | PKCS7_NOVERIFY | PKCS7_NOINTERN) != 1) {
    return Complain(file, "is not signed by " + ca_file + ", or was changed since");
  }
  char* data = nullptr;
  const long size = BIO_get_mem_data(text.get(), &data);
  return std::string(data, static_cast<size_t>(size));
}

/// The text of the first element of this name; empty if there is none.
std::string ElementOf(const std::string& xml, const std::string& name) {
  const size_t begin = xml.find("<" + name + ">");
  const size_t end = xml.find("</" + name + ">");
  if (begin == std::string::npos || end == std::string::npos || end < begin) return "";
  return xml.substr(begin + name.size() + 2, end - begin - name.size() - 2);
}

/// -1 if it is none.
int64_t SecondsOf(const std::string& xml_time) {
  std::tm utc{};
  return strptime(xml_time.c_str(), "%Y-%m-%dT%H:%M:%S", &utc) == nullptr ? -1 : timegm(&utc);
}

/// That the permissions are this participant's and hold now; when they end.
Result<int64_t> CheckPermissions(const Credentials& credentials, const std::string& xml, int64_t now_s) {
  const std::string& file = credentials.permissions;
  const std::string subject = ElementOf(xml, "subject_name");
  if (subject != credentials.subject) {
    return Complain(file,
                    "permits '" + subject + "', and " + credentials.certificate + " is '" + credentials.subject + "'");
  }
  const int64_t begins_s = SecondsOf(ElementOf(xml, "not_before")), ends_s = SecondsOf(ElementOf(xml, "not_after"));
  if (begins_s < 0 || ends_s < 0) return Complain(file, "does not say from when to when it holds");
  if (Status held = CheckPeriod(file, "the permission", begins_s, ends_s, now_s); !held) return held.error();
  return ends_s;
}

/// The texts of all elements of this name.
std::vector<std::string> ElementsOf(const std::string& xml, const std::string& name) {
  std::vector<std::string> texts;
  for (size_t at = xml.find("<" + name + ">"); at != std::string::npos; at = xml.find("<" + name + ">", at + 1))
    texts.push_back(ElementOf(xml.substr(at), name));
  return texts;
}

std::string SubjectOf(const X509* certificate) {
  const Bio text(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(text.get(), X509_get_subject_name(certificate), 0, XN_FLAG_RFC2253);
  char* data = nullptr;
  const long size = BIO_get_mem_data(text.get(), &data);
  return std::string(data, static_cast<size_t>(size));
}

}  // namespace

Result<Credentials> Credentials::Open(const std::string& folder, int64_t now_s) {
  std::error_code error;
  if (!std::filesystem::is_directory(folder, error))
    return Complain(folder, "no such folder; make_keys.py makes one for each role");
  const std::string prefix = std::filesystem::absolute(folder).string() + "/";
  Credentials made;
  made.identity_ca = prefix + "identity_ca.cert.pem";
  made.certificate = prefix + "cert.pem";
  made.private_key = prefix + "key.pem";
  made.permissions_ca = prefix + "permissions_ca.cert.pem";
  made.governance = prefix + "governance.p7s";
  made.permissions = prefix + "permissions.p7s";

  const Result<Certificate> identity_ca = ReadCertificate(made.identity_ca);
  if (!identity_ca) return identity_ca.error();
  const Result<Certificate> certificate = ReadCertificate(made.certificate);
  if (!certificate) return certificate.error();
  const Result<Certificate> permissions_ca = ReadCertificate(made.permissions_ca);
  if (!permissions_ca) return permissions_ca.error();
  for (const auto& [file, held] :
       {std::pair(&made.identity_ca, identity_ca->get()), std::pair(&made.certificate, certificate->get()),
        std::pair(&made.permissions_ca, permissions_ca->get())}) {
    if (Status checked = CheckPeriod(*file, held, now_s); !checked) return checked.error();
  }
  if (X509_verify(certificate->get(), X509_get0_pubkey(identity_ca->get())) != 1)
    return Complain(made.certificate, "is not signed by " + made.identity_ca);
  made.subject = SubjectOf(certificate->get());
  if (Status key = CheckKey(made.private_key, made.certificate, certificate->get()); !key) return key.error();
  const Result<std::string> governance = ReadSigned(made.governance, made.permissions_ca, permissions_ca->get());
  if (!governance) return governance.error();
  const Result<std::string> permissions = ReadSigned(made.permissions, made.permissions_ca, permissions_ca->get());
  if (!permissions) return permissions.error();
  const Result<int64_t> permitted_until_s = CheckPermissions(made, *permissions, now_s);
  if (!permitted_until_s) return permitted_until_s.error();
  made.permitted = *permissions;
  made.expires_s = std::min(*permitted_until_s, SecondsOf(X509_get0_notAfter(certificate->get())));
  return made;
}

Status Credentials::CheckPermitted(int domain, const std::string& partition) const {
  const auto first = ElementsOf(permitted, "min"), last = ElementsOf(permitted, "max");
  bool is_permitted = first.size() != last.size() || first.empty();  // in another form than ours: DDS will judge
  for (size_t i = 0; i < std::min(first.size(), last.size()); ++i)
    is_permitted |= std::atoi(first[i].c_str()) <= domain && domain <= std::atoi(last[i].c_str());
  if (!is_permitted) return Complain(permissions, "does not permit domain " + std::to_string(domain) + " (dds.domain)");
  const auto patterns = ElementsOf(permitted, "partition");
  const auto matches = [&](const std::string& pattern) { return fnmatch(pattern.c_str(), partition.c_str(), 0) == 0; };
  if (!patterns.empty() && std::none_of(patterns.begin(), patterns.end(), matches))
    return Complain(permissions, "does not permit partition " + partition + " (dds.partition)");
  return Ok{};
}

}  // namespace portolan
