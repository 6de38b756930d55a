# An OPC UA server with a torque, a speed as text and a counter, for the test beside: `python3 opcua.py PORT`. Each line of standard input is a command.
import asyncio
import logging
import sys

from asyncua import Server, ua

logging.disable(logging.CRITICAL)


async def main(port):
    server = Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/bench")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    space = await server.register_namespace("urn:bench")
    brake = await server.nodes.objects.add_object(space, "Brake")
    torque = await brake.add_variable(ua.NodeId("Brake.Torque", space), "Torque", 1000.0, ua.VariantType.Float)
    await brake.add_variable(ua.NodeId("Brake.Name", space), "Name", "brake")
    async with server:
        print(f"ns={space}", flush=True)
        loop = asyncio.get_running_loop()
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            match line.split():
                case ["torque", value]:
                    await torque.write_value(ua.Variant(float(value), ua.VariantType.Float))
                case ["bad"]:
                    bad = ua.StatusCode(ua.StatusCodes.BadSensorFailure)
                    await torque.write_value(ua.DataValue(ua.Variant(0.0, ua.VariantType.Float), bad))


asyncio.run(main(int(sys.argv[1])))
