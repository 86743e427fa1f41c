"""The programs that docs/guide/cluster.md gives to SLURM and Kubernetes run here as far as they come without either."""

import re
import shlex

import pytest
from test_docs_pages import check_flgpr

from reading import FENCE, ROOT, read

pytestmark = pytest.mark.slow("checks of pages")

PYTHON = [
    body
    for kind, body in FENCE.findall(read(ROOT / "docs" / "guide" / "cluster.md"))
    if kind == "python"
]
QUANTITY = re.compile(r"\d+(\.\d+)?(m|[KMGT]i?)?")


def run(program, **names):
    """Run a program of the page; give its names, and what it asks to be typed as command lines."""
    asked = []
    names |= {"input": asked.append, "__name__": "program"}
    exec(compile(program, "cluster.md", "exec"), names)
    return names, [
        shlex.split(line.replace(" ... ", " lane.zarr --recipe wang2007 -o survey "))
        for line in asked
    ]


def program(of):
    [found] = [body for body in PYTHON if f"from {of}" in body]
    return found


def options_of(words, tool):
    """Parse the words as Dask's command does; give its options."""
    dask = pytest.importorskip(f"distributed.cli.dask_{tool}")
    return dask.main.make_context(f"dask {tool}", list(words)).params


def check_detect(commands, address):
    [(program_name, *words)] = commands
    assert program_name == "flgpr"
    assert words[words.index("--scheduler") + 1] == address
    check_flgpr(words)


def test_the_slurm_program_writes_a_job_of_workers_with_one_thread_each():
    pytest.importorskip("dask_jobqueue")
    text = program("dask_jobqueue")
    assert '"port": 8786' in text
    names, commands = run(text.replace('"port": 8786', '"port": 0, "dashboard_address": ":0"'))
    with names["cluster"] as cluster:
        script = cluster.job_script()
        check_detect(commands, cluster.scheduler_address)
    for line in ("-p normal", "--cpus-per-task=32", "--mem=60G", "-t 04:00:00"):
        assert f"#SBATCH {line}\n" in script
    assert "\nexport NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1\n" in script
    assert "\nsource /shared/venv/bin/activate\n" in script
    [command] = [line for line in script.splitlines() if "distributed.cli.dask_worker" in line]
    worker = options_of(shlex.split(command)[3:], "worker")
    assert (worker["n_workers"], worker["nthreads"], worker["nanny"]) == ("32", 1, True)


def test_the_kubernetes_program_describes_a_cluster_that_can_start(monkeypatch):
    operator = pytest.importorskip("dask_kubernetes.operator")

    class Given:
        scheduler_address = "tcp://flgpr-scheduler:8786"

        def __init__(self, custom_cluster_spec):
            self.spec = custom_cluster_spec

    monkeypatch.setattr(operator, "KubeCluster", Given)
    names, commands = run(program("dask_kubernetes"))
    given = names["cluster"].spec
    assert (given["apiVersion"], given["kind"], given["metadata"]["name"]) == (
        "kubernetes.dask.org/v1", "DaskCluster", "flgpr",
    )  # fmt: skip
    assert set(given["spec"]) >= {"worker", "scheduler"}
    assert {port["port"] for port in given["spec"]["scheduler"]["service"]["ports"]} >= {8786}
    assert given["spec"]["worker"]["replicas"] == 64
    options = {part: started(given["spec"][part]["spec"], part) for part in ("scheduler", "worker")}
    assert options["scheduler"]["host"] == "0.0.0.0"
    assert options["worker"]["nthreads"] == 1
    check_detect(commands, Given.scheduler_address)


def started(pod, part):
    """Check a pod, and give the options with which Dask starts in it."""
    [container] = pod["containers"]
    assert {"name", "image", "args"} <= set(container)
    assert {"name": "NUMBA_NUM_THREADS", "value": "1"} in container["env"]
    for amounts in container["resources"].values():
        assert set(amounts) == {"cpu", "memory"}
        assert all(QUANTITY.fullmatch(amount) for amount in amounts.values())
    volumes = {
        volume["name"]: volume["persistentVolumeClaim"]["claimName"]
        for volume in pod.get("volumes", [])
    }
    assert {mount["name"] for mount in container.get("volumeMounts", [])} == set(volumes)
    program_name, tool, *options = container["args"]
    assert (program_name, tool) == (
        "dask",
        part,
    )  # dask-worker and dask-scheduler are gone from newer versions
    return options_of(options, part)
