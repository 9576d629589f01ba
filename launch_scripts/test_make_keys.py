#!/usr/bin/env python3
"""Tests of make_keys.py with a stub in place of portolan_permissions; what the documents say is tested with topics.h, that DDS takes them with whole processes."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

import make_keys

HERE = pathlib.Path(__file__).resolve().parent
FILES = {"cert.pem", "key.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s"}
# Says its arguments, and fails where the real one does.
STUB = """#!{python}
import sys
if "bad" in sys.argv:
    sys.exit("portolan_permissions: --partition 'bad'")
print(*sys.argv[1:], sep="|")
"""


def openssl(*arguments):
    return subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, check=False)


class MakeKeysTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.keys = self.folder / "keys"
        program = self.folder / make_keys.PROGRAM
        program.write_text(STUB.format(python=sys.executable))
        program.chmod(0o755)

    def make(self, *arguments):
        command = [sys.executable, "-B", str(HERE / "make_keys.py"), "--bin", str(self.folder), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)

    def made(self, *arguments):
        ended = self.make(*arguments)
        self.assertEqual(ended.returncode, 0, ended.stderr)

    def signed_text(self, folder, document):
        verified = openssl("smime", "-verify", "-text", "-in", folder / document, "-CAfile", folder / "permissions_ca.cert.pem")
        self.assertEqual(verified.returncode, 0, verified.stderr)
        return verified.stdout.strip().split("|")

    def subject(self, folder):
        return openssl("x509", "-in", folder / "cert.pem", "-noout", "-subject", "-nameopt", "RFC2253").stdout.strip()

    def test_each_role_gets_what_belongs_together(self):
        self.made(self.keys)
        self.assertEqual({path.name for path in self.keys.iterdir()}, {"ca", *make_keys.ROLES})
        for role in make_keys.ROLES:
            folder = self.keys / role
            self.assertEqual({path.name for path in folder.iterdir()}, FILES)
            self.assertEqual((folder / "key.pem").stat().st_mode & 0o777, 0o600)
            self.assertEqual(openssl("verify", "-CAfile", folder / "identity_ca.cert.pem", folder / "cert.pem").returncode, 0)
            permissions = self.signed_text(folder, "permissions.p7s")
            self.assertEqual(permissions[0], role)
            self.assertEqual("subject=" + permissions[permissions.index("--subject") + 1], self.subject(folder))
            self.assertEqual(self.signed_text(folder, "governance.p7s")[0], "governance")
        self.assertEqual((self.keys / "ca").stat().st_mode & 0o077, 0)

    def test_another_robot_of_the_same_authority(self):
        self.made(self.keys, "--roles", "tool")
        other = self.folder / "robot_3"
        self.made(other, "--ca", self.keys / "ca", "--roles", "tool,camera", "--name", "robot_3", "--domain", "7", "--partition", "robot_3", "--partition", "fleet")
        self.assertIn("CN=tool.robot_3", self.subject(other / "tool"))
        self.assertFalse((other / "ca").exists())
        self.assertEqual((other / "tool/identity_ca.cert.pem").read_text(), (self.keys / "tool/identity_ca.cert.pem").read_text())
        permissions = " ".join(self.signed_text(other / "tool", "permissions.p7s"))
        self.assertIn("--domain 7 --partition robot_3 --partition fleet", permissions)

    def test_keys_that_are_there_stay_unless_forced(self):
        self.made(self.keys, "--roles", "tool")
        before = (self.keys / "tool/cert.pem").read_text()
        self.assertEqual(self.make(self.keys, "--roles", "tool").returncode, make_keys.EXIT_USAGE)
        self.assertEqual((self.keys / "tool/cert.pem").read_text(), before)
        authority = (self.keys / "ca/identity_ca.key.pem").read_text()
        self.made(self.keys, "--roles", "tool", "--force")
        self.assertNotEqual((self.keys / "tool/cert.pem").read_text(), before)
        self.assertEqual((self.keys / "ca/identity_ca.key.pem").read_text(), authority)

    def test_bad_arguments_leave_nothing(self):
        for text, arguments in (("--roles 'pilot'", ["--roles", "tool,pilot"]), ("--roles ''", ["--roles", ","]), ("--name", ["--name", "a/b"]),
                                ("--days 0", ["--days", "0"]), ("holds no authority", ["--ca", self.folder]), ("--partition 'bad'", ["--partition", "bad"]),
                                ("not in", ["--bin", self.folder / "nowhere"])):
            ended = self.make(self.keys, *arguments)
            self.assertEqual(ended.returncode, make_keys.EXIT_USAGE, ended.stderr)
            self.assertIn(text, ended.stderr)
            self.assertFalse(self.keys.exists(), arguments)

    def test_a_folder_that_cannot_be_made_is_named(self):
        (self.folder / "file").touch()
        ended = self.make(self.folder / "file" / "keys")
        self.assertEqual(ended.returncode, make_keys.EXIT_FAILURE)
        self.assertIn("file/keys", ended.stderr)


if __name__ == "__main__":
    unittest.main()
