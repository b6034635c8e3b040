import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/RunState";
import { useLive } from "../../live/react";
import { age, bytes, dateTime, duration, fixed, kilohertz } from "../../samples/format";
import { fillText } from "../../samples/texts";
import { healthQuery, sessionQuery } from "../../service/api/session";
import { systemQuery, useBackupDatabase, useCheckDatabase } from "../../service/api/system";
import { entryOf } from "../../service/glossary";
import type { SystemState } from "../../wire/types";
import pageStyles from "../Page.module.css";
import { Facts } from "./Facts";
import { FlightRecords } from "./FlightRecords";
import { RecordingsCard } from "./RecordingsCard";
import systemStyles from "./System.module.css";
import { TriggerCard } from "./TriggerCard";
import { TEXTS } from "./texts";

/** Card with the state of disk and database, an integrity check and backups. */

/** Least free space without a warning: a day of recordings takes about 2 GB. */
const LITTLE_BYTES = 2e9;

export function DatabaseCard({ system }: { system: SystemState | undefined }) {
  const backup = useBackupDatabase();
  const check = useCheckDatabase();
  const database = system?.database;
  const newest = system?.backups[0];
  const free = database?.disk_free_bytes ?? 0;
  return (
    <Facts
      title={TEXTS.database}
      facts={[
        [
          TEXTS.databaseEntry,
          database &&
            fillText(TEXTS.databaseSummary, {
              kind: database.kind,
              size: bytes(database.size_bytes),
              schema: database.schema_revision ?? TEXTS.schemaUnknown,
            }),
        ],
        [TEXTS.diskFree, database && <Verdict good={free >= LITTLE_BYTES}>{bytes(free)}</Verdict>],
        [
          TEXTS.lastBackup,
          newest ? `${dateTime(newest.at)}, ${bytes(newest.size_bytes)}, ${newest.name}` : TEXTS.noBackup,
        ],
        [TEXTS.restore, TEXTS.howToRestore],
      ]}
    >
      <div className={systemStyles.actions}>
        <OperatorsOnly>
          <Button variant="default" loading={backup.isPending} onClick={() => backup.mutate()}>
            {TEXTS.backUp}
          </Button>
          <Button variant="default" loading={check.isPending} onClick={() => check.mutate()}>
            {TEXTS.check}
          </Button>
        </OperatorsOnly>
        {check.data && (
          <Verdict good={check.data.length === 0}>
            {check.data.length === 0 ? TEXTS.intact : check.data.join("; ")}
          </Verdict>
        )}
        <Refusal error={backup.error ?? check.error} />
      </div>
    </Facts>
  );
}

/** Card with the state of each link of the safety chain; each link monitors the one before it. */

export function SafetyChain() {
  const chain = useLive((live) => live.state?.chain);
  return (
    <Facts
      title={TEXTS.chain}
      facts={(chain ?? []).map((link) => [
        entryOf(`chain:${link.name}`)?.term ?? link.name,
        <Verdict key={link.name} good={link.good} of={`chain:${link.name}`}>
          {link.silent_s === null
            ? link.says
            : fillText(TEXTS.silentFor, { state: link.says, time: fixed(link.silent_s, 1) })}
        </Verdict>,
      ])}
    />
  );
}

/** Card with the lateness of the control steps in the last minute, and the granted real-time privileges. */

export function Lateness({ system }: { system: SystemState | undefined }) {
  const classes = system?.lateness ?? [];
  const total = classes.reduce((sum, { ticks }) => sum + ticks, 0);
  const granted = system?.granted;
  return (
    <Card title={TEXTS.latenessCard}>
      <div className={pageStyles.tableScroll}>
        <Table aria-label={TEXTS.latenessTable} verticalSpacing={3}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{TEXTS.columnLateness}</Table.Th>
              <Table.Th className={systemStyles.number}>{TEXTS.columnSteps}</Table.Th>
              <Table.Th className={systemStyles.number}>%</Table.Th>
              <Table.Th className={systemStyles.barColumn}>
                <span className={systemStyles.hidden}>{TEXTS.columnShare}</span>
              </Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {classes.map(({ from_us, to_us, ticks }) => (
              <Table.Tr key={from_us}>
                <Table.Td>
                  {to_us === null
                    ? fillText(TEXTS.over, { from: fixed(from_us, 0) })
                    : fillText(TEXTS.between, { from: fixed(from_us, 0), to: fixed(to_us, 0) })}
                </Table.Td>
                <Table.Td className={systemStyles.number}>{ticks}</Table.Td>
                <Table.Td className={systemStyles.number}>
                  {total > 0 ? fixed((100 * ticks) / total, 2) : TEXTS.noStep}
                </Table.Td>
                <Table.Td>
                  <div
                    className={systemStyles.bar}
                    style={{ width: `${share(ticks, total)}%` }}
                    aria-hidden="true"
                  />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
      {granted && (
        <ul className={systemStyles.granted} aria-label={TEXTS.machine}>
          <li>
            <Verdict good={granted.priority > 0}>
              {granted.priority > 0
                ? fillText(TEXTS.fifo, { priority: granted.priority })
                : TEXTS.ordinaryScheduling}
            </Verdict>
          </li>
          <li>
            <Verdict good={granted.memory_locked}>
              {granted.memory_locked ? TEXTS.memoryLocked : TEXTS.memoryNotLocked}
            </Verdict>
          </li>
          <li>
            <Verdict good={granted.timer_slack_ns <= 1}>
              {fillText(TEXTS.timerSlack, { slack: granted.timer_slack_ns })}
            </Verdict>
          </li>
          {granted.refusals.map((refusal) => (
            <li key={refusal}>{refusal}</li>
          ))}
        </ul>
      )}
    </Card>
  );
}

/** Returns the length of a bar [%] on a logarithmic scale, on which one step in a million is visible. */
function share(ticks: number, total: number): number {
  return ticks === 0 ? 0 : (100 * Math.log10(1 + ticks)) / Math.log10(1 + total);
}

/** Page System: state of control loop and service, flight records and the list of signals. */

export default function SystemPage() {
  const state = useLive((live) => live.state);
  const link = useLive((live) => live.link);
  const layout = useLive((live) => live.layout);
  const missed = useLive((live) => live.missed);
  const health = useQuery({ ...healthQuery, refetchInterval: 5000 });
  const session = useQuery(sessionQuery);
  const system = useQuery(systemQuery).data;
  const timing = state?.timing;
  return (
    <div className={pageStyles.page}>
      <h1 className={pageStyles.title}>{TEXTS.title}</h1>
      <div className={systemStyles.grid}>
        <Facts
          title={TEXTS.loop}
          facts={[
            [
              TEXTS.process,
              state && (
                <Verdict good={state.link.alive}>{state.link.alive ? TEXTS.alive : TEXTS.notRunning}</Verdict>
              ),
            ],
            [
              TEXTS.started,
              state &&
                (state.link.starts === 1
                  ? TEXTS.startedOnce
                  : fillText(TEXTS.startedTimes, { count: state.link.starts })),
            ],
            [TEXTS.uptime, state && duration(state.tick * (layout?.period_s ?? 0.001))],
            [TEXTS.period, timing && `${fixed(1000 * timing.period_s, 3)} ms`],
            [TEXTS.rate, timing && kilohertz(timing.rate_Hz)],
            [TEXTS.latenessMedian, timing && `${fixed(timing.lateness_p50_ms, 3)} ms`],
            [TEXTS.lateness99, timing && `${fixed(timing.lateness_p99_ms, 3)} ms`],
            [TEXTS.overruns, timing && fixed(timing.overruns, 0)],
          ]}
        />
        <Facts
          title={TEXTS.service}
          facts={[
            [TEXTS.version, health.data?.version],
            [TEXTS.software, system && versions(system.versions)],
            [
              TEXTS.plant,
              state &&
                fillText(TEXTS.plantAndParameters, {
                  plant: state.plant.says || state.plant.name,
                  parameters: state.parameters,
                }),
            ],
            [
              TEXTS.signedInAs,
              session.data && fillText(TEXTS.person, { name: session.data.name, role: session.data.role }),
            ],
            [TEXTS.operator, state && (state.holder?.name ?? TEXTS.nobody)],
            [TEXTS.roundTrip, link.latency_ms === null ? undefined : age(link.latency_ms)],
            [TEXTS.disconnects, fixed(link.failures, 0)],
            [TEXTS.missedSamples, fixed(missed, 0)],
            [
              TEXTS.interface,
              <a key="docs" href="./api/docs">
                /api/docs
              </a>,
            ],
            [
              TEXTS.faultInjection,
              <Link key="developer" href="/system/developer">
                {TEXTS.developerPage}
              </Link>,
            ],
          ]}
        />
        <SafetyChain />
        <DatabaseCard system={system} />
        <RecordingsCard />
        <Lateness system={system} />
      </div>
      <TriggerCard />
      <FlightRecords />
      <Card title={TEXTS.signals}>
        <div className={pageStyles.tableScroll}>
          <Table aria-label={TEXTS.signals} verticalSpacing={3}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{TEXTS.columnName}</Table.Th>
                <Table.Th>{TEXTS.columnSymbol}</Table.Th>
                <Table.Th>{TEXTS.columnUnit}</Table.Th>
                <Table.Th>{TEXTS.columnMeaning}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {layout?.fields.map((field) => (
                <Table.Tr key={field.name}>
                  <Table.Td>
                    <code>{field.name}</code>
                  </Table.Td>
                  <Table.Td>{field.symbol}</Table.Td>
                  <Table.Td>{field.unit}</Table.Td>
                  <Table.Td>{field.meaning}</Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </div>
      </Card>
    </div>
  );
}

function versions(all: Record<string, string>): string {
  return Object.entries(all)
    .filter(([name]) => name !== "Sinew")
    .map(([name, version]) => `${name} ${version}`)
    .join(", ");
}
