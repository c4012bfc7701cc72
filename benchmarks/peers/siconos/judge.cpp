// Impacts by the LZB law and short runs of a frictionless planar dimer on a shaking plate, on Siconos (4.4).
//
//   judge impact < scene      velocities after an impact that closes two contacts of a body, or of a row of bodies
//   judge run < scene         states of the dimer up to the given end, or to where Siconos gives up
//
// A scene is a list of numbers, in the order in which they are read below. Each line of the answer that begins with ">" is a
// list of numbers; the last one is the processor time [s]. A line that begins with "stopped" says why a run ended early.

#include <SiconosKernel.hpp>
#include <MultipleImpact.hpp>
#include <MultipleImpactNSL.hpp>

#include <array>
#include <cmath>
#include <ctime>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

using std::make_shared;
using std::shared_ptr;

namespace {

constexpr double ZERO = 1e-30;  // what counts as none in an impact; Siconos' own 2.2e-16 is no part of the scale of a scene
constexpr unsigned STEPS = 2000000000;

double next()
{
  double value;
  if(!(std::cin >> value)) throw std::runtime_error("the scene is too short");
  return value;
}

std::vector<double> next(unsigned n)
{
  std::vector<double> values(n);
  for(double& value : values) value = next();
  return values;
}

shared_ptr<SiconosVector> vector_of(const std::vector<double>& values)
{
  auto made = make_shared<SiconosVector>(values.size());
  for(unsigned k = 0; k < values.size(); ++k) made->setValue(k, values[k]);
  return made;
}

// One contact: restitution, stiffness and exponent.
struct Contact
{
  double e, k, eta;
  shared_ptr<MultipleImpactNSL> law() const { return make_shared<MultipleImpactNSL>(e, k, eta); }
};

std::array<Contact, 2> next_contacts()
{
  const auto e = next(2), k = next(2);
  const double eta = next();
  return {Contact{e[0], k[0], eta}, Contact{e[1], k[1], eta}};
}

// The part of a scene that Siconos carries through time: impacts by LZB, in steps of impulse, and contact that lasts by an LCP.
struct Engine
{
  shared_ptr<NonSmoothDynamicalSystem> system;
  shared_ptr<EventDriven> simulation;
  shared_ptr<LsodarOSI> integrator = make_shared<LsodarOSI>();

  Engine(shared_ptr<LagrangianDS> body, const std::array<shared_ptr<Relation>, 2>& gaps,
         const std::array<Contact, 2>& contacts, double impulse, double step, double end)
    : system(make_shared<NonSmoothDynamicalSystem>(0.0, end))
  {
    system->insertDynamicalSystem(body);
    for(unsigned i = 0; i < 2; ++i) system->link(make_shared<Interaction>(contacts[i].law(), gaps[i]), body);
    simulation = make_shared<EventDriven>(system, make_shared<TimeDiscretisation>(0.0, step));
    simulation->insertIntegrator(integrator);
    auto impact = make_shared<MultipleImpact>("BiStiffness", impulse);
    impact->setTolImpact(ZERO);
    impact->SetTolVel(ZERO);
    impact->SetTolEner(ZERO);
    impact->SetZeroVelEndImp(ZERO);
    impact->SetZeroEnerEndImp(ZERO);
    impact->SetNstepMax(STEPS);
    simulation->insertNonSmoothProblem(impact, SICONOS_OSNSP_ED_IMPACT);
    simulation->insertNonSmoothProblem(make_shared<LCP>(), SICONOS_OSNSP_ED_SMOOTH_ACC);
  }
};

// The gap of one end of the dimer, whose coordinates are the height of its centre of mass and its dip angle.
class Gap : public LagrangianScleronomousR
{
  const double _lever, _radius;  // signed distance of the ball's centre from the centre of mass; the ball's radius

public:
  Gap(double lever, double radius) : _lever(lever), _radius(radius)
  {
    _jachq = make_shared<SimpleMatrix>(1, 2);
    _dotjachq = make_shared<SimpleMatrix>(1, 2);
  }
  void computeh(const BlockVector& q, BlockVector&, SiconosVector& y) override
  {
    y.setValue(0, q.getValue(0) + _lever * std::sin(q.getValue(1)) - _radius);
  }
  void computeJachq(const BlockVector& q, BlockVector&) override
  {
    _jachq->setValue(0, 0, 1.0);
    _jachq->setValue(0, 1, _lever * std::cos(q.getValue(1)));
  }
  void computeDotJachq(const BlockVector& q, BlockVector&, const BlockVector& rate) override
  {
    _dotjachq->setValue(0, 0, 0.0);
    _dotjachq->setValue(0, 1, -_lever * std::sin(q.getValue(1)) * rate.getValue(1));
  }
};

// The dimer in the frame of the plate, whose acceleration is a force on the centre of mass there.
class Dimer : public LagrangianDS
{
  const double _m, _g, _shake, _omega, _phase;

public:
  Dimer(shared_ptr<SiconosVector> q, shared_ptr<SiconosVector> rate, shared_ptr<SiconosMatrix> mass, double g, double shake,
        double omega, double phase)
    : LagrangianDS(q, rate, mass), _m(mass->getValue(0, 0)), _g(g), _shake(shake), _omega(omega), _phase(phase)
  {
    setFExtPtr(make_shared<SiconosVector>(2));
    _hasConstantFExt = false;
  }
  void computeFExt(double time) override
  {
    _fExt->setValue(0, _m * (_shake * std::sin(_omega * time + _phase) - _g));
    _fExt->setValue(1, 0.0);
  }
};

shared_ptr<SimpleMatrix> diagonal(const std::vector<double>& values)
{
  auto made = make_shared<SimpleMatrix>(values.size(), values.size());
  for(unsigned k = 0; k < values.size(); ++k) made->setValue(k, k, values[k]);
  return made;
}

void tell(const std::vector<double>& values)
{
  std::cout << ">";
  for(const double value : values) std::cout << " " << value;
  std::cout << std::endl;
}

// Impulse step; number of coordinates; their masses; gap rates of both contacts per rate; e, k of both; eta; rates before.
void impact()
{
  const double impulse = next();
  const unsigned n = next();
  const auto masses = next(n);
  std::array<shared_ptr<Relation>, 2> gaps;
  for(auto& gap : gaps)
  {
    const auto row = next(n);
    auto matrix = make_shared<SimpleMatrix>(1, n);
    for(unsigned k = 0; k < n; ++k) matrix->setValue(0, k, row[k]);
    gap = make_shared<LagrangianLinearTIR>(matrix);
  }
  const auto contacts = next_contacts();
  auto body = make_shared<LagrangianDS>(make_shared<SiconosVector>(n), vector_of(next(n)), diagonal(masses));
  Engine engine(body, gaps, contacts, impulse, 1e-9, 1e-9);
  const clock_t begun = clock();
  engine.simulation->initialize();
  engine.simulation->advanceToEvent();
  engine.simulation->processEvents();
  const double taken = double(clock() - begun) / CLOCKS_PER_SEC;
  std::vector<double> after;
  for(unsigned k = 0; k < n; ++k) after.push_back(body->velocity()->getValue(k));
  tell(after);
  tell({taken});
}

// Masses m, J_t; levers and radii of both ends; e, k of both; eta; g, amplitude of the plate's acceleration, its angular
// velocity and phase; height and dip, rates of both; impulse step; tolerance of LSODAR and of a closed gap; step; end.
void run()
{
  const auto masses = next(2), levers = next(2), radii = next(2);
  const auto contacts = next_contacts();
  const auto plate = next(4);
  const auto q = vector_of(next(2)), rate = vector_of(next(2));
  const double impulse = next(), tolerance = next(), closed = next(), step = next(), end = next();
  std::array<shared_ptr<Relation>, 2> gaps;
  for(unsigned i = 0; i < 2; ++i) gaps[i] = make_shared<Gap>(levers[i], radii[i]);
  auto body = make_shared<Dimer>(q, rate, diagonal(masses), plate[0], plate[1], plate[2], plate[3]);
  Engine engine(body, gaps, contacts, impulse, step, end);
  const clock_t begun = clock();
  try
  {
    engine.simulation->setToleranceED(closed);
    engine.simulation->initialize();
    engine.integrator->setTol(1, tolerance, tolerance);
    while(engine.simulation->hasNextEvent())
    {
      engine.simulation->advanceToEvent();
      engine.simulation->processEvents();
      const auto& at = *body->q();
      const auto& rates = *body->velocity();
      tell({engine.simulation->startingTime(), at.getValue(0), at.getValue(1), rates.getValue(0), rates.getValue(1)});
    }
  }
  catch(const Siconos::exception& error)
  {
    const std::string* why = boost::get_error_info<Siconos::exception::extra_message>(error);
    std::cout << "stopped: " << (why ? *why : error.what()) << std::endl;
  }
  tell({double(clock() - begun) / CLOCKS_PER_SEC});
}

}  // namespace

int main(int count, char** words)
{
  const std::string verb = count == 2 ? words[1] : "";
  std::cout.precision(17);
  if(verb == "impact") impact();
  else if(verb == "run") run();
  else std::cerr << "judge impact | run < scene" << std::endl;
  return verb != "impact" && verb != "run";
}
