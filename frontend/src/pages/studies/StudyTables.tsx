/** The figures of a study and how they are spread, and the rows that they come from. */

import { Table } from "@mantine/core";
import { Shown } from "../../components/Absent";
import { Card } from "../../components/Card";
import { Explained } from "../../components/Explained";
import { Unit } from "../../components/Unit";
import { fixed, settingValue, short } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { counted } from "../../samples/words";
import { useAngles } from "../../service/angles";
import type { StudyDetail, StudyFigure, StudyShare } from "../../wire/types";
import page from "../Page.module.css";

const STATISTICS = [
  ["least", "Least"],
  ["p5", "5 %"],
  ["median", "Median"],
  ["mean", "Mean"],
  ["p95", "95 %"],
  ["largest", "Largest"],
  ["deviation", "Std. dev."],
] as const;

export function SharesCard({ shares }: { shares: readonly StudyShare[] }) {
  return (
    <Card
      title="Runs"
      aside={<span className={page.dim}>with the 95 % confidence interval of each share</span>}
    >
      <div className={page.tableScroll}>
        <Table aria-label="Runs">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>Share</Table.Th>
              <Table.Th className={page.number}>Runs</Table.Th>
              <Table.Th className={page.number}>Of</Table.Th>
              <Table.Th className={page.number}>%</Table.Th>
              <Table.Th className={page.number}>Interval [%]</Table.Th>
              <Table.Th className={page.number}>Not judged</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {shares.map(({ name, label, count, of, left_out, percent, low, high }) => (
              <Table.Tr key={name}>
                <Table.Td>{label}</Table.Td>
                <Table.Td className={page.number}>{fixed(count, 0)}</Table.Td>
                <Table.Td className={page.number}>{fixed(of, 0)}</Table.Td>
                <Table.Td className={page.number}>
                  <Shown value={percent} why="no run was judged">
                    {(known) => fixed(known, 1)}
                  </Shown>
                </Table.Td>
                <Table.Td className={page.number}>
                  <Shown value={low === null || high === null ? null : [low, high]} why="no run was judged">
                    {(known) => known.map((end) => fixed(end, 1)).join(" to ")}
                  </Shown>
                </Table.Td>
                <Table.Td className={page.number}>{fixed(left_out, 0)}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}

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
              {STATISTICS.map(([which, label]) => (
                <Table.Th key={which} className={page.number}>
                  {label}
                </Table.Th>
              ))}
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {figures.map((figure) => (
              <Table.Tr key={figure.name}>
                <Table.Td>
                  <Explained of={`figure:${figure.name}`}>{figure.label}</Explained>
                </Table.Td>
                <Table.Td>
                  <Unit unit={figure.unit} />
                </Table.Td>
                <Table.Td className={page.number}>
                  {fixed(figure.count, 0)}
                  {figure.missing > 0 && ` of ${fixed(figure.count + figure.missing, 0)}`}
                </Table.Td>
                {STATISTICS.map(([which]) => (
                  <Table.Td key={which} className={page.number}>
                    <Shown
                      value={figure[which]}
                      why={
                        figure.unstable > 0
                          ? `unstable loop in ${counted(figure.unstable, "run")}`
                          : "one run only"
                      }
                    >
                      {(known) => short(known * readingOf(figure.unit, angles).factor)}
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
  const symbols = new Map(detail.axes.map(({ name, symbol }) => [name, symbol]));
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
                  {symbols.get(name) ?? name}
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
