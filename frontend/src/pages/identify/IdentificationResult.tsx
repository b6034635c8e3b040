/** One identification: progress while it runs, then a verdict and what came out, by kind. */

import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { RunState } from "../../components/RunState";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { dateTime, fixed } from "../../samples/format";
import { identificationQuery, isRunning } from "../../service/queries";
import type { Identification } from "../../wire/types";
import page from "../Page.module.css";
import { ActuatorResult } from "./ActuatorResult";
import { ApplyParameters } from "./ApplyParameters";
import { MotorResult } from "./MotorResult";
import { SpringRunResult } from "./SpringResult";

export function IdentificationResult({ id }: { id: number }) {
  const { data, error } = useQuery(identificationQuery(id));
  if (error) {
    return (
      <Card title="Result">
        <p className={page.empty}>{error.message}</p>
      </Card>
    );
  }
  if (data === undefined) {
    return (
      <Card title="Result">
        <p className={page.empty}>Loading …</p>
      </Card>
    );
  }
  return (
    <Card title="Result" aside={<RunState state={data.status} reason={data.message} />}>
      <p className={page.lead}>
        Run {data.run}
        {data.tension_N !== null && <> at {fixed(data.tension_N, 0)} N</>}
        {data.S_nominal !== null && <>, stiffness {fixed(data.S_nominal, 2)} N·m/rad</>},{" "}
        {dateTime(data.created)}. <Link href={`/runs/${data.run}`}>Data of the run</Link>
      </p>
      {isRunning(data.status) ? <RunProgress identification={data} /> : <Models identification={data} />}
    </Card>
  );
}

function RunProgress({ identification }: { identification: Identification }) {
  const task = useLive((live) => live.state?.task ?? null);
  const mine = task !== null && task.run === identification.run && task.phase !== "evaluation";
  return (
    <p className={page.empty}>
      {mine ? "It runs; its models stand here afterwards." : "estimating models …"}
    </p>
  );
}

function Models({ identification }: { identification: Identification }) {
  const { kind, estimate, message } = identification;
  if (estimate === null) {
    return <p className={page.empty}>{message === "" ? "No model came out of this run." : message}</p>;
  }
  const parts = [identification.G_q, identification.G_S, ...identification.motors];
  const good = identification.usable && parts.every((part) => part === null || part.grade === "usable");
  return (
    <>
      <Verdict good={good}>{message}</Verdict>
      {kind === "actuator" && <ActuatorResult identification={identification} />}
      {kind === "motor" && <MotorResult identification={identification} />}
      {kind === "spring" && <SpringRunResult identification={identification} />}
      {kind !== "actuator" && <ApplyParameters estimate={estimate} />}
    </>
  );
}
