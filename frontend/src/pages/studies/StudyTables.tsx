/** The figures of a study and how they are spread, and the rows that they come from. */

import { Table } from "@mantine/core";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { Unit } from "../../components/Unit";
import { fixed, settingValue, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { StudyDetail, StudyFigure } from "../../wire/types";
import page from "../Page.module.css";

export function FiguresCard({ figures }: { figures: readonly StudyFigure[] }) {
  const angles = useAngles();
  return (
    <Card title="Figures">
      <div className={page.tableScroll}>
        <Table aria-label="Figures">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Figure</Table.Th>
              <Table.Th>Unit</Table.Th>
              <Table.Th className={page.number}>Runs</Table.Th>
              <Table.Th className={page.number}>Least</Table.Th>
              <Table.Th className={page.number}>Median</Table.Th>
              <Table.Th className={page.number}>Mean</Table.Th>
              <Table.Th className={page.number}>Largest</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {figures.map(({ name, label, unit, count, least, median, mean, largest }) => (
              <Table.Tr key={name}>
                <Table.Td>
                  <Explained of={`figure:${name}`}>{label}</Explained>
                </Table.Td>
                <Table.Td>
                  <Unit unit={unit} />
                </Table.Td>
                <Table.Td className={page.number}>{fixed(count, 0)}</Table.Td>
                {Object.entries({ least, median, mean, largest }).map(([which, value]) => (
                  <Table.Td key={which} className={page.number}>
                    <Shown value={value} why="not measured">
                      {(known) => short(known * readingOf(unit, angles).factor)}
                    </Shown>
                  </Table.Td>
                ))}
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

export function RowsCard({ detail }: { detail: StudyDetail }) {
  const { rows, study } = detail;
  const varied = Object.keys(rows[0]?.values ?? {});
  const first = `the first ${fixed(rows.length, 0)} of ${fixed(study.done, 0)}`;
  return (
    <Card
      title="Rows"
      aside={<span className={page.dim}>{rows.length < study.done ? first : "all"}, in SI units</span>}
    >
      <div className={page.tableScroll}>
        <Table aria-label="Rows">
          <Table.Thead>
            <Table.Tr>
              <Table.Th className={page.number}>Run</Table.Th>
              {varied.map((name) => (
                <Table.Th key={name} className={page.number}>
                  {name}
                </Table.Th>
              ))}
              <Table.Th>End</Table.Th>
              <Table.Th>Criteria</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {rows.map(({ number, values, state, detail: why, passed }) => (
              <Table.Tr key={number}>
                <Table.Td className={page.number}>{fixed(number, 0)}</Table.Td>
                {varied.map((name) => (
                  <Table.Td key={name} className={page.number}>
                    {settingValue(values[name] ?? "")}
                  </Table.Td>
                ))}
                <Table.Td title={why}>{state}</Table.Td>
                <Table.Td>{passed === null ? "not judged" : passed ? "hold" : "do not hold"}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}
