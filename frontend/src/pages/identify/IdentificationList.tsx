import { Button, Checkbox, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { type FormEvent, type ReactNode, useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { SeriesReports } from "../../components/Downloads";
import { TextField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { RunState, Verdict } from "../../components/RunState";
import { Absent, SignalName, ValueOrReason } from "../../components/values";
import { useLive } from "../../live/react";
import { dateTime, fixed, heading, significant } from "../../samples/format";
import { withUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useActivateBank, useBuildBank } from "../../service/api/banks";
import { identificationQuery } from "../../service/api/identifications";
import { isRunning } from "../../service/api/polling";
import { useMayCommand, useWhyNoRetuning } from "../../service/control/control";
import { RefusedFields } from "../../service/forms/refusals";
import type { Bank, Identification } from "../../wire/types";
import { nameOf } from "../banks/BankTable";
import pageStyles from "../Page.module.css";
import { ActuatorResult, sessionOf } from "./ActuatorResult";
import identifyStyles from "./Identify.module.css";
import { MotorResult } from "./MotorResult";
import { ApplyParameters } from "./ParametersCard";
import { SpringRunResult } from "./SpringResult";
import { TEXTS } from "./texts";

interface IdentificationListProps {
  readonly identifications: readonly Identification[] | undefined;
  readonly selected: number | undefined;
  readonly chosen: ReadonlySet<number>;
  onChoose(id: number): void;
  /** Shows the result of a row. */
  onShow(id: number): void;
}

export function IdentificationList(props: IdentificationListProps) {
  const { identifications, selected, chosen, onChoose, onShow } = props;
  const may = useMayCommand();
  const session = sessionOf(identifications ?? []);
  return (
    <Card title={TEXTS.runs}>
      {identifications?.length === 0 && <p className={pageStyles.empty}>{TEXTS.noRuns}</p>}
      {identifications === undefined && <p className={pageStyles.empty}>{TEXTS.loading}</p>}
      {identifications !== undefined && identifications.length > 0 && (
        <div className={pageStyles.tableScroll}>
          <Table aria-label={TEXTS.runs} highlightOnHover className={pageStyles.cards ?? ""}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{may === false ? "" : TEXTS.bank}</Table.Th>
                <Table.Th>{TEXTS.run}</Table.Th>
                <Table.Th>{TEXTS.kindColumn}</Table.Th>
                <Table.Th>{TEXTS.time}</Table.Th>
                <Table.Th className={pageStyles.number}>{TEXTS.tension}</Table.Th>
                <Table.Th className={pageStyles.number}>S [N·m/rad]</Table.Th>
                <Table.Th className={pageStyles.number}>
                  {TEXTS.gainOf} <SignalName name="G_q" />
                </Table.Th>
                <Table.Th className={pageStyles.number}>
                  {TEXTS.lagOf} <SignalName name="G_q" /> [s]
                </Table.Th>
                <Table.Th className={pageStyles.number}>
                  {TEXTS.gainOf} <SignalName name="G_S" />
                </Table.Th>
                <Table.Th className={pageStyles.number}>
                  {TEXTS.lagOf} <SignalName name="G_S" /> [s]
                </Table.Th>
                <Table.Th>{TEXTS.status}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {identifications.map((row) => (
                <Table.Tr
                  key={row.id}
                  bg={row.id === selected ? "var(--accent-soft)" : undefined}
                  className={identifyStyles.pressed ?? ""}
                  onClick={(event) => {
                    if ((event.target as Element).closest("a, input, button") === null) onShow(row.id);
                  }}
                >
                  <Table.Td>
                    {may !== false && (
                      <Checkbox
                        size="xs"
                        aria-label={fillText(TEXTS.useRun, { run: row.id })}
                        checked={chosen.has(row.id)}
                        disabled={row.kind !== "actuator" || !row.usable}
                        onChange={() => onChoose(row.id)}
                      />
                    )}
                  </Table.Td>
                  <Table.Td style={{ whiteSpace: "nowrap" }}>
                    <Link href={`/identify/${row.id}`}>{fillText(TEXTS.runLink, { run: row.id })}</Link>
                  </Table.Td>
                  <Table.Td>{heading(row.kind)}</Table.Td>
                  <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(row.created)}</Table.Td>
                  <Table.Td className={pageStyles.number}>
                    <ValueOrReason value={row.tension_N} why={TEXTS.noSingleTension}>
                      {(tension_N) => fixed(tension_N, 0)}
                    </ValueOrReason>
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {row.S_nominal === null ? noModel(row) : fixed(row.S_nominal, 2)}
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {row.G_q === null ? noModel(row) : significant(row.G_q.K, 3)}
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {row.G_q === null ? noModel(row) : significant(row.G_q.T, 3)}
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {row.G_S === null ? noModel(row) : significant(row.G_S.K, 3)}
                  </Table.Td>
                  <Table.Td className={pageStyles.number}>
                    {row.G_S === null ? noModel(row) : significant(row.G_S.T, 3)}
                  </Table.Td>
                  <Table.Td>
                    <RunState state={row.status} reason={row.message} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      )}
      {session.length > 1 && (
        <section className={identifyStyles.report} aria-label={TEXTS.sessionReport}>
          <span className={pageStyles.dim}>{fillText(TEXTS.sessionRuns, { count: session.length })}</span>
          <SeriesReports runs={session} />
        </section>
      )}
    </Card>
  );
}

/** Returns the content of a cell without a model: "no model" for an actuator, "not applicable" for other kinds. */
function noModel({ kind }: Identification): ReactNode {
  return kind === "actuator" ? TEXTS.noModel : <Absent why={fillText(TEXTS.notForKind, { kind })} />;
}

/** Builds a bank from the ticked runs, and activates it. */
export function BankBuilder({ chosen, onBuilt }: { chosen: ReadonlySet<number>; onBuilt: () => void }) {
  const [name, setName] = useState("");
  const build = useBuildBank();
  const runs = [...chosen].sort((a, b) => a - b);
  const ready = runs.length > 0 && name.trim() !== "";
  const inSight = runs.length > 0 || build.data !== undefined;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (ready) build.mutate({ name: name.trim(), identifications: runs }, { onSuccess: onBuilt });
  }

  return (
    <Card title={TEXTS.bankFromRuns} className={inSight ? identifyStyles.builder : undefined}>
      <RefusedFields error={build.error} about={name}>
        <form className={identifyStyles.build} aria-label={TEXTS.bankFromRuns} onSubmit={submit}>
          <TextField name="name" label={TEXTS.bankName} value={name} onChange={setName} />
          <Button type="submit" variant="default" disabled={!ready} loading={build.isPending}>
            {TEXTS.buildBank}
          </Button>
          <span className={pageStyles.dim}>
            {runs.length === 0
              ? TEXTS.selectRuns
              : fillText(TEXTS.selectedRuns, {
                  runs: runs.map((run) => fillText(TEXTS.runItem, { run })).join(", "),
                })}
          </span>
        </form>
        {build.data && <Built bank={build.data} />}
        <Refusal error={build.error} about={name} />
      </RefusedFields>
    </Card>
  );
}

/** Shows the built bank, with the next step. */
function Built({ bank }: { bank: Bank }) {
  const activate = useActivateBank();
  const active = useLive((live) => live.state?.tuning.bank?.id === bank.id);
  const locked = useWhyNoRetuning();
  const name = nameOf(bank);
  return (
    <div className={identifyStyles.built}>
      <span>
        {TEXTS.bankBuiltBefore} <Link href={`/banks/${bank.id}`}>{name}</Link> {TEXTS.bankBuiltAfter}
      </span>
      {active ? (
        <output>{TEXTS.bankActive}</output>
      ) : (
        <Button
          size="compact-sm"
          aria-label={fillText(TEXTS.activateBank, { bank: name })}
          disabled={locked !== null}
          loading={activate.isPending}
          onClick={() => activate.mutate(bank.id)}
        >
          {TEXTS.activate}
        </Button>
      )}
      <Refusal error={activate.error} text={active ? null : locked} />
    </div>
  );
}

/** Shows one identification: its progress, then the verdict and the results by kind. */
export function IdentificationResult({ id }: { id: number }) {
  const { data, error } = useQuery(identificationQuery(id));
  if (error) {
    return (
      <Card title={TEXTS.result}>
        <p className={pageStyles.empty}>{error.message}</p>
      </Card>
    );
  }
  if (data === undefined) {
    return (
      <Card title={TEXTS.result}>
        <p className={pageStyles.empty}>{TEXTS.loading}</p>
      </Card>
    );
  }
  return (
    <Card title={TEXTS.result} aside={<RunState state={data.status} reason={data.message} />}>
      <p className={pageStyles.lead}>
        {fillText(TEXTS.runLink, { run: data.run })}
        {data.tension_N !== null &&
          ` ${fillText(TEXTS.resultAt, { tension: withUnit(fixed(data.tension_N, 0), "N") })}`}
        {data.S_nominal !== null &&
          `, ${fillText(TEXTS.resultStiffness, { stiffness: withUnit(fixed(data.S_nominal, 2), "N·m/rad") })}`}
        , {dateTime(data.created)}. <Link href={`/runs/${data.run}`}>{TEXTS.runData}</Link>
      </p>
      {isRunning(data.status) ? <RunProgress identification={data} /> : <Models identification={data} />}
    </Card>
  );
}

function RunProgress({ identification }: { identification: Identification }) {
  const task = useLive((live) => live.state?.task ?? null);
  const mine = task !== null && task.run === identification.run && task.phase !== "evaluation";
  return <p className={pageStyles.empty}>{mine ? TEXTS.running : TEXTS.estimating}</p>;
}

function Models({ identification }: { identification: Identification }) {
  const { kind, estimate, message } = identification;
  if (estimate === null) {
    return <p className={pageStyles.empty}>{message === "" ? TEXTS.noResult : message}</p>;
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
