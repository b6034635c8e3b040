/** All identification runs; a tick chooses one for a bank. */

import { Checkbox, Table } from "@mantine/core";
import type { ReactNode } from "react";
import { Link } from "wouter";
import { Absent, Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { RunState } from "../../components/RunState";
import { SeriesReports } from "../../components/SeriesReports";
import { SignalName } from "../../components/SignalName";
import { dateTime, fixed, significant } from "../../samples/format";
import { heading } from "../../samples/words";
import { useMayCommand } from "../../service/useMayCommand";
import type { Identification } from "../../wire/types";
import page from "../Page.module.css";
import { sessionOf } from "./candidates";
import styles from "./Identify.module.css";

interface IdentificationListProps {
  readonly identifications: readonly Identification[] | undefined;
  readonly selected: number | undefined;
  readonly chosen: ReadonlySet<number>;
  onChoose(id: number): void;
  /** A row was pressed: its result is to be shown. */
  onShow(id: number): void;
}

export function IdentificationList(props: IdentificationListProps) {
  const { identifications, selected, chosen, onChoose, onShow } = props;
  const may = useMayCommand();
  const session = sessionOf(identifications ?? []);
  return (
    <Card title="Identification runs">
      {identifications?.length === 0 && (
        <p className={page.empty}>
          No identification yet. Bring the loop to pretension, then start one at each tension.
        </p>
      )}
      {identifications === undefined && <p className={page.empty}>Loading …</p>}
      {identifications !== undefined && identifications.length > 0 && (
        <div className={page.tableScroll}>
          <Table aria-label="Identification runs" highlightOnHover className={page.cards ?? ""}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{may === false ? "" : "Bank"}</Table.Th>
                <Table.Th>Run</Table.Th>
                <Table.Th>Of</Table.Th>
                <Table.Th>When</Table.Th>
                <Table.Th className={page.number}>Tension [N]</Table.Th>
                <Table.Th className={page.number}>S [N·m/rad]</Table.Th>
                <Table.Th className={page.number}>
                  K of <SignalName name="G_q" />
                </Table.Th>
                <Table.Th className={page.number}>
                  T of <SignalName name="G_q" /> [s]
                </Table.Th>
                <Table.Th className={page.number}>
                  K of <SignalName name="G_S" />
                </Table.Th>
                <Table.Th className={page.number}>
                  T of <SignalName name="G_S" /> [s]
                </Table.Th>
                <Table.Th>End</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {identifications.map((row) => (
                <Table.Tr
                  key={row.id}
                  bg={row.id === selected ? "var(--accent-soft)" : undefined}
                  className={styles.pressed ?? ""}
                  onClick={(event) => {
                    if ((event.target as Element).closest("a, input, button") === null) onShow(row.id);
                  }}
                >
                  <Table.Td>
                    {may !== false && (
                      <Checkbox
                        size="xs"
                        aria-label={`Use run ${row.id}`}
                        checked={chosen.has(row.id)}
                        disabled={row.kind !== "actuator" || !row.usable}
                        onChange={() => onChoose(row.id)}
                      />
                    )}
                  </Table.Td>
                  <Table.Td style={{ whiteSpace: "nowrap" }}>
                    <Link href={`/identify/${row.id}`}>Run {row.id}</Link>
                  </Table.Td>
                  <Table.Td>{heading(row.kind)}</Table.Td>
                  <Table.Td style={{ whiteSpace: "nowrap" }}>{dateTime(row.created)}</Table.Td>
                  <Table.Td className={page.number}>
                    <Shown value={row.tension_N} why="not at one tension">
                      {(tension_N) => fixed(tension_N, 0)}
                    </Shown>
                  </Table.Td>
                  <Table.Td className={page.number}>
                    {row.S_nominal === null ? noModel(row) : fixed(row.S_nominal, 2)}
                  </Table.Td>
                  <Table.Td className={page.number}>
                    {row.G_q === null ? noModel(row) : significant(row.G_q.K, 3)}
                  </Table.Td>
                  <Table.Td className={page.number}>
                    {row.G_q === null ? noModel(row) : significant(row.G_q.T, 3)}
                  </Table.Td>
                  <Table.Td className={page.number}>
                    {row.G_S === null ? noModel(row) : significant(row.G_S.K, 3)}
                  </Table.Td>
                  <Table.Td className={page.number}>
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
        <section className={styles.report} aria-label="Report of the session">
          <span className={page.dim}>The {session.length} identifications of this day in one report:</span>
          <SeriesReports runs={session} />
        </section>
      )}
    </Card>
  );
}

/** Motors and springs have no such columns; an actuator's run without a model says so. */
function noModel({ kind }: Identification): ReactNode {
  return kind === "actuator" ? "no model" : <Absent why={`a ${kind} has none`} />;
}
