/** One identification: progress while it runs, then both models with their quality and a verdict. */

import { Progress, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { RunState } from "../../components/RunState";
import { SignalName } from "../../components/SignalName";
import { taskProgress } from "../../components/status";
import { Verdict } from "../../components/Verdict";
import { useLive } from "../../live/react";
import { dateTime, duration, fixed, significant } from "../../samples/format";
import { identificationQuery, isRunning } from "../../service/queries";
import type { Identification, Model } from "../../wire/types";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

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
        Run {data.run} at {fixed(data.tension_N, 0)} N
        {data.S_nominal !== null && <>, stiffness {fixed(data.S_nominal, 2)} N·m/rad</>},{" "}
        {dateTime(data.created)}. <Link href={`/runs/${data.run}`}>Data of the run</Link>
      </p>
      {isRunning(data.status) ? <RunProgress identification={data} /> : <Models identification={data} />}
    </Card>
  );
}

function RunProgress({ identification }: { identification: Identification }) {
  const task = useLive((live) => live.state?.task ?? null);
  const mine = task !== null && task.run === identification.run;
  const done = mine ? taskProgress(task) : identification.progress;
  return (
    <div className={page.fields} style={{ padding: "16px 0" }}>
      <Progress.Root size={10}>
        <Progress.Section value={100 * done} aria-label="Identification progress" />
      </Progress.Root>
      <span>
        {mine
          ? `${task.phase.replaceAll("_", " ")}: ${duration(task.elapsed_s)} of ${duration(task.duration_s)}`
          : "estimating models …"}
      </span>
    </div>
  );
}

function Models({ identification }: { identification: Identification }) {
  const { G_q, G_S, message } = identification;
  if (G_q === null && G_S === null) {
    return <p className={page.empty}>{message === "" ? "No model came out of this run." : message}</p>;
  }
  return (
    <>
      <div className={page.halves}>
        {G_q && <ModelView name="G_q" path="θ_A,ref → q" unit="" model={G_q} />}
        {G_S && <ModelView name="G_S" path="θ_A,ref → S" unit="N·m/rad²" model={G_S} />}
      </div>
      {message !== "" && <p className={page.lead}>{message}</p>}
    </>
  );
}

function ModelView({ name, path, unit, model }: { name: string; path: string; unit: string; model: Model }) {
  const deviation = 100 * (model.K / model.gain_geometry - 1);
  const sign = deviation > 0 ? "+" : "";
  return (
    <section className={styles.model} aria-label={`Model ${name}`}>
      <h3 style={{ margin: "8px 0 0", fontSize: 14 }}>
        <SignalName name={name} /> <span className={page.dim}>{path}</span>
      </h3>
      <dl className={styles.figures}>
        <div>
          <dt>Gain K {unit !== "" && `[${unit}]`}</dt>
          <dd>{significant(model.K, 4)}</dd>
          <small>
            geometry {significant(model.gain_geometry, 3)}, {sign}
            {fixed(deviation, 1)} %
          </small>
        </div>
        <div>
          <dt>Sum of lags T [s]</dt>
          <dd>{significant(model.T, 3)}</dd>
          <small>first-order reduction</small>
        </div>
        <div>
          <dt>Fit [%]</dt>
          <dd>{fixed(model.fit_percent, 1)}</dd>
          <small>on data not used</small>
        </div>
      </dl>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={`Parameters of ${name}`}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{model.structure}</Table.Th>
            <Table.Th className={page.number}>value</Table.Th>
            <Table.Th className={page.number}>standard error</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {Object.entries(model.parameters).map(([parameter, value]) => (
            <Table.Tr key={parameter}>
              <Table.Td>{parameter}</Table.Td>
              <Table.Td className={page.number}>{significant(value, 4)}</Table.Td>
              <Table.Td className={page.number}>{significant(model.std_errors[parameter], 2)}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
      <span className={page.dim}>Estimated by {model.method.replaceAll("_", " ")}.</span>
      <Verdict good={model.usable}>{model.verdict}</Verdict>
    </section>
  );
}
