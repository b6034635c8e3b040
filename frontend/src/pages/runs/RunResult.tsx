/** What a run came to: verdict, criteria, figures; of an identification its own verdict. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { RunState, unevaluated } from "../../components/RunState";
import { Outcome, Verdict } from "../../components/Verdict";
import { useEvaluate } from "../../service/commands";
import { experimentQuery, identificationQuery } from "../../service/queries";
import type { Run } from "../../wire/types";
import { Figures } from "../experiments/Figures";
import page from "../Page.module.css";

export function RunResult({ run }: { run: Run }) {
  return (
    <Card
      title="Result"
      aside={<RunState state={run.end_state} reason={run.end_reason} unevaluated={unevaluated(run)} />}
    >
      <div className={page.fields}>
        <Evaluated run={run} />
      </div>
    </Card>
  );
}

function Evaluated({ run }: { run: Run }) {
  const evaluate = useEvaluate(run.id);
  if (run.end_state === "running") return <span>The run is not over: there is no result yet.</span>;
  if (run.evaluation === "none") {
    return <span>Recorded by hand: no program was played, nothing is judged.</span>;
  }
  if (run.evaluation === "under_way" || evaluate.isPending) return <span>The result is being computed.</span>;
  if (run.evaluation === "done") {
    return run.kind.endsWith("_identification") ? <Identified id={run.id} /> : <Judged id={run.id} />;
  }
  return (
    <>
      <Verdict good={false}>Not evaluated: {unevaluated(run)}</Verdict>
      <OperatorsOnly>
        <div className={page.actions}>
          <Button variant="default" size="compact-sm" onClick={() => evaluate.mutate()}>
            Evaluate again
          </Button>
          <Refusal error={evaluate.error} />
        </div>
      </OperatorsOnly>
    </>
  );
}

function Judged({ id }: { id: number }) {
  const { data, error } = useQuery(experimentQuery(id));
  if (data === undefined) return <span>{error?.message ?? "Loading …"}</span>;
  return (
    <>
      <Outcome of={data} />
      <Figures criteria={data.criteria} metrics={data.metrics} />
    </>
  );
}

function Identified({ id }: { id: number }) {
  const { data, error } = useQuery(identificationQuery(id));
  if (data === undefined) return <span>{error?.message ?? "Loading …"}</span>;
  return (
    <>
      <Verdict good={data.usable}>{data.message}</Verdict>
      <Link href={`/identify/${id}`}>Models and fits of this identification</Link>
    </>
  );
}
