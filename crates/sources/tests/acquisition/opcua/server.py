# An OPC UA server with the nodes of a bench, for the tests beside: `python3 server.py PORT FOLDER [plain|user|secure]`.
# `user` wants the user "bench" with the password "right"; `secure` signs and encrypts, with the certificates that it makes in FOLDER.
# It prints "ready" when it can be asked. Each line of standard input is a command: `NODE VALUE` or `NODE VALUE STATUS`;
# `sessions` writes how many there are to the file FOLDER/sessions; `quit` closes it.
import asyncio
import logging
import sys
from pathlib import Path

from asyncua import Server, ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.crypto.cert_gen import setup_self_signed_certificate
from asyncua.crypto.truststore import TrustStore
from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions
from cryptography.x509.oid import ExtendedKeyUsageOID

logging.disable(logging.CRITICAL)

USAGE = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
SUBJECT = {"countryName": "AT", "organizationName": "bench"}
NODES = [
    ("Drive.Speed", 1500.0, ua.VariantType.Double),
    ("Brake.Torque", 10.0, ua.VariantType.Float),
    ("Oil.Temperature", 650, ua.VariantType.Int16),
    ("Brake.Name", "brake", ua.VariantType.String),
    ("Brake.On", True, ua.VariantType.Boolean),
]


class Users:
    def get_user(self, iserver, username=None, password=None, certificate=None):
        if username == "bench" and password == "right":
            return User(role=UserRole.User, name="bench")
        return None


async def certificates(folder):
    for name, uri in [("server", "urn:bench"), ("client", "urn:gearwatch"), ("stranger", "urn:gearwatch")]:
        if not (folder / f"{name}.der").exists():
            await setup_self_signed_certificate(folder / f"{name}.pem", folder / f"{name}.der", uri, "localhost", USAGE, SUBJECT)


async def make(port, folder, kind):
    server = Server(user_manager=Users()) if kind == "user" else Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/bench")
    await server.set_application_uri("urn:bench")
    policies = [ua.SecurityPolicyType.NoSecurity]
    if kind == "user":
        server.set_identity_tokens([ua.UserNameIdentityToken])
    if kind == "secure":
        await certificates(folder)
        await server.load_certificate(folder / "server.der")
        await server.load_private_key(folder / "server.pem")
        policies = [ua.SecurityPolicyType.Basic256Sha256_Sign, ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt]
        trusted = folder / "trusted"
        trusted.mkdir(exist_ok=True)
        (trusted / "client.der").write_bytes((folder / "client.der").read_bytes())
        store = TrustStore([trusted], [])
        await store.load()
        server.set_certificate_validator(CertificateValidator(CertificateValidatorOptions.TRUSTED, store))
    server.set_security_policy(policies)
    return server


async def main(port, folder, kind):
    server = await make(port, Path(folder), kind)
    space = await server.register_namespace("urn:bench:nodes")
    assert space == 2, space
    bench = await server.nodes.objects.add_object(ua.NodeId("Bench", space), "Bench")
    nodes = {}
    for name, value, type in NODES:
        nodes[name] = (await bench.add_variable(ua.NodeId(name, space), name, value, type), type)
    async with server:
        print("ready", flush=True)
        loop = asyncio.get_running_loop()
        while line := (await loop.run_in_executor(None, sys.stdin.readline)).split():
            if line == ["quit"]:
                break
            if line == ["sessions"]:
                Path(folder, "count").write_text(str(len(server.iserver._external_sessions)))
                Path(folder, "count").rename(Path(folder, "sessions"))
                continue
            node, type = nodes[line[0]]
            value = ua.Variant(float(line[1]) if type in (ua.VariantType.Double, ua.VariantType.Float) else int(line[1]), type)
            status = ua.StatusCode(getattr(ua.StatusCodes, line[2])) if len(line) > 2 else ua.StatusCode()
            await server.write_attribute_value(node.nodeid, ua.DataValue(value, status))


asyncio.run(main(int(sys.argv[1]), sys.argv[2], (sys.argv[3:] or ["plain"])[0]))
