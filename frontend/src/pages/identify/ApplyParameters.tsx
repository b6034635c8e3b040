/** What applying an identification would change about the parameters in force, and the button that does it. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Shown } from "../../components/Absent";
import { SignalName } from "../../components/SignalName";
import { useLive } from "../../live/react";
import { fixed, significant } from "../../samples/format";
import { parametersQuery, useApplyParameters } from "../../service/comparedModels";
import type { ParameterChange } from "../../wire/types";
import { NextMode } from "../operate/NextMode";
import page from "../Page.module.css";
import { ChangeButton } from "./ChangeButton";
import styles from "./Identify.module.css";

export function ApplyParameters({ estimate }: { estimate: number }) {
  const asked = useQuery(parametersQuery(estimate));
  const apply = useApplyParameters();
  const onCard = useLive((live) => ["rig", "virtual_card"].includes(live.state?.plant.kind ?? ""));
  const proposal = asked.data?.proposal;
  return (
    <section className={styles.model} aria-label="Apply to the parameters">
      <h3 className={styles.heading}>What applying it would change</h3>
      {asked.error && <p className={page.empty}>{asked.error.message}</p>}
      {asked.isPending && <p className={page.empty}>Comparing …</p>}
      {proposal && proposal.problem !== "" && <p className={page.empty}>{proposal.problem}.</p>}
      {apply.data && (
        <output className={page.dim}>
          Version {apply.data.versions[0]?.number} is in force. <NextMode need="start" />
        </output>
      )}
      {proposal && proposal.problem === "" && (
        <>
          <ChangeTable label="Parameters that would change" changes={proposal.changes} />
          <span className={page.dim}>
            Controller, forecasts and predictions go by it then; a simulated plant stays as it is. The control
            loop starts anew, and a bank made with the former parameters is put aside with them.
            {onCard &&
              " The encoders lose their zero with the loop: do Zero or Homing of the bring-up anew after it."}
          </span>
          <ChangeButton
            error={apply.error}
            pending={apply.isPending}
            about={estimate}
            onPress={() => apply.mutate(estimate)}
          >
            Apply to the parameters
          </ChangeButton>
        </>
      )}
    </section>
  );
}

interface ChangeTableProps {
  readonly label: string;
  readonly changes: readonly ParameterChange[];
}

export function ChangeTable({ label, changes }: ChangeTableProps) {
  return (
    <div className={styles.scroll}>
      <Table withRowBorders={false} verticalSpacing={2} aria-label={label}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Of</Table.Th>
            <Table.Th className={page.number}>before</Table.Th>
            <Table.Th className={page.number}>after</Table.Th>
            <Table.Th>Unit</Table.Th>
            <Table.Th className={page.number}>change [%]</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {changes.map((one) => (
            <Table.Tr key={`${one.name} ${one.side}`}>
              <Table.Td>
                <Named name={one.name} /> {one.name.startsWith("k") ? "of spring" : "of motor"} {one.side}
              </Table.Td>
              <Table.Td className={page.number}>
                <Shown value={one.before} why="it had none">
                  {(value) => significant(value, 5)}
                </Shown>
              </Table.Td>
              <Table.Td className={page.number}>
                <Shown value={one.after} why="it has none any more">
                  {(value) => significant(value, 5)}
                </Shown>
              </Table.Td>
              <Table.Td>{one.unit}</Table.Td>
              <Table.Td className={page.number}>
                <Shown value={one.percent} why="there is nothing to compare with">
                  {(percent) => `${percent > 0 ? "+" : ""}${fixed(percent, 2)}`}
                </Shown>
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </div>
  );
}

/** k0, k1 ... are coefficients; the others are in the notation. */
function Named({ name }: { name: string }) {
  if (!/^k\d$/.test(name)) return <SignalName name={name} />;
  return (
    <span className="symbol">
      <i>k</i>
      <sub>{name.slice(1)}</sub>
    </span>
  );
}
