#!/usr/bin/env python3
"""Makes what DDS Security needs: a certificate authority and, for each role, an identity and its permissions. See docs/security.md."""

import argparse
import datetime
import os
import pathlib
import re
import shutil
import ssl
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
# In an installed tree the scripts are in share/portolan/launch_scripts; in the repository the programs are in install/bin.
BIN_FOLDERS = (HERE.parents[2] / "bin", HERE.parent / "install" / "bin")
PROGRAM = "portolan_permissions"
ROLES = ("frontend_tracker", "backend_mapper", "loop_closer", "atlas_server", "tool", "camera")
EXIT_FAILURE, EXIT_USAGE = 1, 2

# Both vendors take it, and its handshake is short.
CURVE = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1")
CA_DAYS = 3650
IDENTITY_CA, PERMISSIONS_CA = "identity_ca", "permissions_ca"


class Failure(Exception):
    """What goes wrong, and the exit code."""

    def __init__(self, message, code=EXIT_FAILURE):
        super().__init__(message)
        self.code = code


def make_parser():
    parser = argparse.ArgumentParser(
        prog="make_keys.py", allow_abbrev=False,
        description="Makes OUT/ca, the authority of a deployment, unless it is there already, and OUT/ROLE for each role: certificate, key and permissions, "
                    "which are to be copied to the machine where the role runs and given as --security OUT. OUT/ca stays at home.",
        epilog="Exit code: 0 done, 1 openssl failed or a file could not be written, 2 bad arguments.")
    add = parser.add_argument
    add("out", type=pathlib.Path, metavar="OUT", help="folder of the keys")
    add("--ca", type=pathlib.Path, metavar="DIR", help="the authority of an earlier call (default: OUT/ca)")
    add("--roles", default=",".join(ROLES), help="which to make (default: %(default)s)")
    add("--name", default="", help="goes into the certificates' names, e.g. robot_3: to tell apart the keys of several robots")
    add("--domain", default="0-230", metavar="N[-M]", help="DDS domains that are permitted (default: %(default)s)")
    add("--partition", action="append", metavar="P",
        help="DDS partition that is permitted, with wildcards; may be given again (default: *, all robots)")
    add("--image-topic", metavar="NAME", default="rt/image", help="the configuration's dds.image_topic (default: %(default)s)")
    add("--days", type=int, default=365, help="how long the certificates hold (default: %(default)s)")
    add("--force", action="store_true", help="replace keys that are there already; the authority stays")
    add("--bin", type=pathlib.Path, metavar="DIR", help="folder of the programs (default: install/bin)")
    return parser


def find_permissions_program(folder):
    for candidate in [folder] if folder else BIN_FOLDERS:
        if os.access(candidate / PROGRAM, os.X_OK):
            return candidate / PROGRAM
    raise Failure(f"{PROGRAM}: not in {folder or ' or '.join(map(str, BIN_FOLDERS))}; run launch_scripts/build.sh first", EXIT_USAGE)


def check(options):
    options.roles = [role for role in options.roles.split(",") if role]
    unknown = [role for role in options.roles if role not in ROLES]
    if unknown or not options.roles:
        raise Failure(f"--roles '{','.join(unknown)}': expected some of {','.join(ROLES)}", EXIT_USAGE)
    if not re.fullmatch(r"[A-Za-z0-9_.-]{0,40}", options.name):
        raise Failure(f"--name '{options.name}': letters, digits, _ - and . expected, at most 40", EXIT_USAGE)
    if not 1 <= options.days < CA_DAYS:
        raise Failure(f"--days {options.days}: expected 1 to {CA_DAYS - 1}", EXIT_USAGE)
    if shutil.which("openssl") is None:
        raise Failure("openssl is not installed (apt-get install openssl)", EXIT_USAGE)
    existing = [role for role in options.roles if (options.out / role).exists()]
    if existing and not options.force:
        raise Failure(f"{options.out / existing[0]} is there already; --force replaces it", EXIT_USAGE)
    if options.ca is not None and not (options.ca / f"{IDENTITY_CA}.key.pem").exists():
        raise Failure(f"--ca {options.ca}: holds no authority ({IDENTITY_CA}.key.pem)", EXIT_USAGE)


def run(command, text=None):
    done = subprocess.run([str(word) for word in command], input=text, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise Failure(f"{command[0]} {command[1]}: {done.stderr.strip()}", EXIT_USAGE if command[0] != "openssl" else EXIT_FAILURE)
    return done.stdout


def make_authority(folder):
    """Two of them, as the standard has it: one says who somebody is, the other what he may do."""
    folder.mkdir(parents=True, mode=0o700)
    for name in (IDENTITY_CA, PERMISSIONS_CA):
        run(["openssl", "req", "-x509", *CURVE, "-nodes", "-days", CA_DAYS, "-subj", f"/O=Portolan/CN={name}",
             "-keyout", folder / f"{name}.key.pem", "-out", folder / f"{name}.cert.pem"])


def sign(text, ca, file):
    run(["openssl", "smime", "-sign", "-text", "-out", file, "-signer", ca / f"{PERMISSIONS_CA}.cert.pem", "-inkey", ca / f"{PERMISSIONS_CA}.key.pem"], text)


def make_identity(common_name, days, ca, folder):
    """@return the certificate's subject, in the form of RFC 2253, and from when to when it holds, as the permissions say it."""
    request = run(["openssl", "req", "-new", *CURVE, "-nodes", "-subj", f"/O=Portolan/CN={common_name}", "-keyout", folder / "key.pem"])
    certificate = folder / "cert.pem"
    run(["openssl", "x509", "-req", "-days", days, "-CA", ca / f"{IDENTITY_CA}.cert.pem", "-CAkey", ca / f"{IDENTITY_CA}.key.pem", "-out", certificate], request)
    said = run(["openssl", "x509", "-in", certificate, "-noout", "-subject", "-startdate", "-enddate", "-nameopt", "RFC2253"])
    fields = dict(line.split("=", 1) for line in said.splitlines())
    period = (datetime.datetime.fromtimestamp(ssl.cert_time_to_seconds(fields[end]), datetime.timezone.utc) for end in ("notBefore", "notAfter"))
    return fields["subject"], *(moment.strftime("%Y-%m-%dT%H:%M:%SZ") for moment in period)


def scope_of(options):
    partitions = [word for partition in options.partition or ["*"] for word in ("--partition", partition)]
    return ["--domain", options.domain, *partitions, "--image-topic", options.image_topic]


def make_role(role, options, program, governance, ca, folder):
    common_name = f"{role}.{options.name}" if options.name else role
    subject, begin, end = make_identity(common_name, options.days, ca, folder)
    permissions = run([program, role, "--subject", subject, "--not-before", begin, "--not-after", end, *scope_of(options)])
    sign(permissions, ca, folder / "permissions.p7s")
    sign(governance, ca, folder / "governance.p7s")
    for name in (IDENTITY_CA, PERMISSIONS_CA):
        shutil.copy(ca / f"{name}.cert.pem", folder)
    for file in folder.iterdir():
        file.chmod(0o600 if file.name == "key.pem" else 0o644)


def main(arguments):
    options = make_parser().parse_args(arguments)
    try:
        check(options)
        program = find_permissions_program(options.bin)
        governance = run([program, "governance", *scope_of(options)])
        os.umask(0o077)
        options.out.mkdir(parents=True, exist_ok=True)
        ca = options.ca or options.out / "ca"
        if not ca.exists():
            make_authority(ca)
        for role in options.roles:
            # Whole or not at all: made beside its place and moved there.
            with tempfile.TemporaryDirectory(dir=options.out) as scratch:
                made = pathlib.Path(scratch) / role
                made.mkdir()
                make_role(role, options, program, governance, ca, made)
                shutil.rmtree(options.out / role, ignore_errors=True)
                made.rename(options.out / role)
    except (Failure, OSError) as error:
        print(f"make_keys.py: {error}", file=sys.stderr)
        return getattr(error, "code", EXIT_FAILURE)
    print(f"{', '.join(options.roles)} in {options.out}, for {options.days} days; the authority's keys in {ca} stay here")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
