"""An S3-compatible store (moto) on a free port, filled over its own protocol with boto3.

Prints the port, then does what each line of its standard input says, and prints "ok" or the error:
    sync FOLDER PREFIX    every file of the folder, with its path as the key
    put FILE KEY          one file
    delete KEY
"""

import logging
import os
import sys

import boto3
from moto.server import ThreadedMotoServer

logging.disable(logging.CRITICAL)
server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
server.start()
_, port = server.get_host_and_port()
s3 = boto3.client(
    "s3", endpoint_url=f"http://127.0.0.1:{port}", aws_access_key_id="test", aws_secret_access_key="secret-of-the-test",
    region_name="us-east-1")
s3.create_bucket(Bucket="museum")


def put(file, key):
    with open(file, "rb") as body:
        s3.put_object(Bucket="museum", Key=key, Body=body.read())


print(port, flush=True)
for line in sys.stdin:
    what, *rest = line.rstrip("\n").split("\t")
    try:
        if what == "sync":
            for folder, _, files in os.walk(rest[0]):
                for name in files:
                    path = os.path.join(folder, name)
                    key = os.path.relpath(path, rest[0])
                    put(path, f"{rest[1]}/{key}" if rest[1] else key)
        elif what == "put":
            put(*rest)
        elif what == "delete":
            s3.delete_object(Bucket="museum", Key=rest[0])
        print("ok", flush=True)
    except Exception as e:
        print(f"{type(e).__name__}: {e}", flush=True)
os._exit(0)
